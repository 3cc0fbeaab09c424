"use strict";
// The table of objects: sorted, searched and filtered in memory; a part of the rows is in the page at a time.
(() => {
  const ROWS_SHOWN = 50;
  const table = document.getElementById("table");
  if (!table) return;
  const body = table.tBodies[0];
  const values = JSON.parse(document.getElementById("values").textContent);
  const [form] = document.getElementsByClassName("filters");
  const [search, material, source, status] = ["search", "material", "source", "status"].map((id) =>
    document.getElementById(id),
  );
  const [found, where, before, after] = ["found", "where", "before", "after"].map((id) =>
    document.getElementById(id),
  );
  const text = (element) => element.textContent.trim();
  const rows = [...body.rows].map((element, index) => {
    const [, ...words] = [...element.cells].slice(0, 4).map(text);
    const [name, ...more] = [...element.cells[0].querySelectorAll("a, code")].map(text);
    words.unshift([name ?? text(element.cells[0]), ...more].join(" "));
    element.classList.remove("late");
    return {
      element,
      texts: words,
      words: words.join("\n").toLowerCase(),
      numbers: values[index],
    };
  });
  const order = new Intl.Collator(undefined, { numeric: true });
  const initial = rows.map((_, index) => index);
  let sorted = initial;
  let first = 0;

  const matches = (row, terms) =>
    (!material.value || row.texts[1] === material.value) &&
    (!source.value || row.texts[2] === source.value) &&
    (!status.value || row.texts[3] === status.value) &&
    terms.every((term) => row.words.includes(term));

  const show = () => {
    const terms = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const chosen = sorted.filter((index) => matches(rows[index], terms));
    first = Math.min(first, Math.max(0, Math.ceil(chosen.length / ROWS_SHOWN) - 1) * ROWS_SHOWN);
    const last = Math.min(first + ROWS_SHOWN, chosen.length);
    body.replaceChildren(...chosen.slice(first, last).map((index) => rows[index].element));
    const objects = `${rows.length} object${rows.length === 1 ? "" : "s"}`;
    found.textContent = chosen.length === rows.length ? objects : `${chosen.length} of ${objects}`;
    where.textContent = `${chosen.length ? first + 1 : 0} to ${last} of ${chosen.length}`;
    before.disabled = first === 0;
    after.disabled = last === chosen.length;
    before.parentElement.hidden = chosen.length <= ROWS_SHOWN;
    keep();
  };

  // What is chosen is in the address: a link shows the same rows.
  const keep = () => {
    const state = new URLSearchParams();
    for (const control of [search, material, source, status]) if (control.value) state.set(control.id, control.value);
    if (sets.value !== usual) state.set("order", sets.value);
    if (first) state.set("from", first + 1);
    if (!table.classList.contains("tiled")) state.set("view", "table");
    history.replaceState(null, "", state.size ? `#${state}` : location.pathname + location.search);
  };

  const recall = () => {
    const state = new URLSearchParams(location.hash.slice(1));
    search.value = state.get("search") ?? "";
    for (const select of [material, source, status, sets]) {
      const known = [...select.options].some(({ value }) => value === state.get(select.id));
      select.value = known ? state.get(select.id) : select === sets ? usual : "";
    }
    const tiled = table.classList.toggle("tiled", state.get("view") !== "table");
    view.setAttribute("aria-pressed", String(!tiled));
    reorder();
    first = ROWS_SHOWN * Math.floor(Math.max(0, state.get("from") - 1 || 0) / ROWS_SHOWN);
    show();
  };

  const compared = (column, direction) => {
    if (typeof column === "string") {
      const place = Number(column.slice(4));
      return (a, b) => direction * order.compare(rows[a].texts[place], rows[b].texts[place]) || a - b;
    }
    // What has no number comes last in both directions.
    return (a, b) => {
      const [x, y] = [rows[a].numbers[column], rows[b].numbers[column]];
      if (x === null || y === null) return (x === null) - (y === null) || a - b;
      return direction * (x - y) || a - b;
    };
  };

  const headers = [...table.tHead.rows[0].cells];
  const sets = document.getElementById("order");
  const titles = headers.map((header) => [...header.childNodes].map((one) => one.textContent).join(" ").trim());
  headers.forEach((header, place) => {
    const column = header.dataset.sort === "text" ? `text${place}` : Number(header.dataset.sort);
    for (const [sign, direction] of [["↑", "ascending"], ["↓", "descending"]]) {
      const first = header.getAttribute("aria-sort") === direction;
      sets.append(new Option(`${titles[place]} ${sign}`, `${place} ${direction}`, first, first));
    }
    const button = document.createElement("button");
    button.type = "button";
    button.append(...header.childNodes);
    header.append(button);
    header.sort = (direction) => {
      for (const other of headers) other.removeAttribute("aria-sort");
      header.setAttribute("aria-sort", direction);
      sets.value = `${place} ${direction}`;
      sorted = [...initial].sort(compared(column, direction === "ascending" ? 1 : -1));
      first = 0;
      show();
    };
    button.addEventListener("click", () =>
      header.sort(header.getAttribute("aria-sort") === "ascending" ? "descending" : "ascending"),
    );
  });
  const usual = sets.value;
  const reorder = () => {
    const [place, direction] = sets.value.split(" ");
    headers[place].sort(direction);
  };
  sets.addEventListener("change", reorder);

  const view = document.getElementById("view");
  view.hidden = false;
  view.addEventListener("click", () => {
    view.setAttribute("aria-pressed", String(!table.classList.toggle("tiled")));
    keep();
  });
  const player = new Audio();
  for (const { element } of rows) {
    const button = element.querySelector(".hear");
    if (!button) continue;
    button.hidden = false;
    button.addEventListener("click", () => {
      player.src = button.dataset.sound;
      player.play();
    });
  }

  const restart = () => {
    first = 0;
    show();
  };
  search.addEventListener("input", restart);
  for (const select of [material, source, status]) select.addEventListener("change", restart);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(() => sets.dispatchEvent(new Event("change"))));
  const turn = (by) => () => {
    first = Math.max(0, first + by);
    show();
    table.scrollIntoView({ block: "start", behavior: "instant" });
  };
  before.addEventListener("click", turn(-ROWS_SHOWN));
  after.addEventListener("click", turn(ROWS_SHOWN));
  // Not of a link into the page.
  addEventListener("hashchange", () => location.hash.includes("=") && recall());
  recall();
})();
