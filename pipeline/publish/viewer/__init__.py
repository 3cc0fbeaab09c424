"""Object Files in a browser: `live` asks the file itself, `static` needs nothing but the page."""
