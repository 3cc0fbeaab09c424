// Players of a page: each `<div class="player" data-object data-script>` starts when it is first seen.
import { element } from "./elements.js";
import { mount } from "./panel.js";
import { StoredObject } from "./stored_object.js";

function loaded(address) {
  return new Promise((resolve, reject) => {
    const script = element("script", { src: address });
    script.addEventListener("load", resolve);
    script.addEventListener("error", () => reject(new Error(`${address} could not be read.`)));
    document.head.append(script);
  });
}

async function start(place) {
  const id = place.dataset.object;
  const words = element("p", { class: "player-wait", role: "status" }, "Opening the object …");
  place.replaceChildren(words);
  try {
    const known = () => (window.objectfolderPlayers ?? {})[id];
    if (!known()) await loaded(place.dataset.script);
    if (!known()) throw new Error(`${place.dataset.script} does not have the object ${id}.`);
    mount(place, await StoredObject.open(id, known()));
  } catch (error) {
    words.setAttribute("role", "alert");
    words.textContent = `The object cannot be shown: ${error.message}`;
  }
}

function startAll() {
  const watcher = new IntersectionObserver(
    (entries) => {
      for (const { isIntersecting, target } of entries) {
        if (!isIntersecting) continue;
        watcher.unobserve(target);
        start(target);
      }
    },
    { rootMargin: "200px" },
  );
  document.querySelectorAll(".player[data-script]").forEach((place) => watcher.observe(place));
}

if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", startAll);
else startAll();
