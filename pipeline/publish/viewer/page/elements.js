// Elements of a page. Data goes only through `textContent` and attributes, never through markup.

const SVG = "http://www.w3.org/2000/svg";

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

export const element = (tag, attributes = {}, ...children) =>
  fill(document.createElement(tag), attributes, children);
export const drawn = (tag, attributes = {}, ...children) =>
  fill(document.createElementNS(SVG, tag), attributes, children);

// A slider with its name before it and its value after it; `shown` writes the value, `scale` maps 0..1 to it.
export function slider(name, { low, high, step, value, shown, changed }) {
  const output = element("output", { class: "player-value" }, shown(value));
  const input = element("input", {
    type: "range", min: low, max: high, step, value, "aria-valuetext": shown(value), "aria-label": name,
    oninput: () => {
      const now = Number(input.value);
      output.textContent = shown(now);
      input.setAttribute("aria-valuetext", shown(now));
      changed(now);
    },
  });
  const label = element("label", { class: "player-slider" }, element("span", {}, name), input, output);
  const set = (now) => {
    input.value = String(now);
    output.textContent = shown(now);
    input.setAttribute("aria-valuetext", shown(now));
  };
  return { label, input, set };
}

// One of several, as radio buttons that look like one control.
let groups = 0;
export function choice(name, options, chosen, changed) {
  const group = `player-group-${(groups += 1)}`;
  const buttons = options.map(([value, text]) =>
    element(
      "label", {},
      element("input", {
        type: "radio", name: group, value, checked: value === chosen, onchange: () => changed(value),
      }),
      element("span", {}, text),
    ),
  );
  return element(
    "fieldset", { class: "player-choice" }, element("legend", {}, name),
    element("div", {}, ...buttons),
  );
}

// Hands a file to the reader.
export function saved(content, name) {
  const address = URL.createObjectURL(content);
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}
