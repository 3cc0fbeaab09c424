"""Where objects come from: published collections, and what carries their files here safely."""
