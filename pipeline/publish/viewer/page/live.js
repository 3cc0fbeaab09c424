// The page of `objectfolder view`.
import { element } from "./elements.js";
import { LiveObject } from "./live_object.js";
import { mount } from "./panel.js";

const place = document.getElementById("player");
const say = (id, text) => (document.getElementById(id).textContent = text);
try {
  const object = await LiveObject.open();
  const { name, material, sides_m, frequencies, licence, attribution, file, objects } = object.facts;
  document.title = `${name} – Object File`;
  say("name", name);
  const sides = `${sides_m.map((side) => (side * 100).toPrecision(3)).join(" × ")} cm`;
  const modes = frequencies.length ? `${frequencies.length} modes from ${Math.round(frequencies[0])} Hz` : "no audible mode";
  say("facts", [material, sides, modes, file].filter(Boolean).join(" · "));
  say("credit", [licence, attribution].filter(Boolean).join(" · "));
  const list = element("select", { id: "objects" }, ...objects.map((one, number) => new Option(one, number)));
  list.value = new URLSearchParams(location.search).get("object") ?? "0";
  if (objects.length > 1) document.querySelector("header").prepend(element("label", {}, "Object ", list));
  list.addEventListener("change", () => {
    const asked = new URLSearchParams(location.search);
    asked.set("object", list.value);
    location.assign(`?${asked}`);
  });
  const panel = mount(place, object);
  object.failed = (error) => panel.say(error.message);
} catch (error) {
  place.replaceChildren(
    element("p", { class: "player-wait", role: "alert" }, `The object cannot be shown: ${error.message}`),
  );
}
