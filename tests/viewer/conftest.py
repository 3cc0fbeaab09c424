"""The browser, for all tests of pages of one object."""

from tests.browser import browser, open_page, tabs

__all__ = ["browser", "open_page", "tabs"]
