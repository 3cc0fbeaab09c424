// Names and places that a keyboard and a screen reader need and the theme leaves out.
const named = {
  ".md-search": "Search",
  "#__search": "Search",
  "#__drawer": "Navigation",
};

function complete() {
  for (const [selector, name] of Object.entries(named))
    document.querySelector(selector)?.setAttribute("aria-label", name);
  // A table that is cut at the page's edge scrolls by the keyboard, too.
  for (const wrap of document.querySelectorAll(".md-typeset__scrollwrap"))
    if (wrap.scrollWidth > wrap.clientWidth) wrap.tabIndex = 0;
  // One button beside a block of code is no landmark.
  for (const buttons of document.querySelectorAll(".md-code__nav")) buttons.role = "presentation";
  // The corner above the names of rows heads nothing.
  for (const corner of document.querySelectorAll("th:empty"))
    corner.replaceWith(document.createElement("td"));
}

complete();
// The theme wraps tables and adds buttons after the page is there.
new MutationObserver(complete).observe(document.body, { childList: true, subtree: true });
