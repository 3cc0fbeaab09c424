// The player: an image to turn, a lamp to move, and what a blow or a press answers.
import { clamp } from "./algebra.js";
import { partials, partialsTable, picture, spectrum } from "./charts.js";
import { DIRECTIONS } from "./contact.js";
import { choice, element, saved, slider } from "./elements.js";
import { gestures } from "./gestures.js";
import { audioContext, play, wavOf } from "./listening.js";
import { Orbit } from "./orbit.js";
import { pythonText } from "./python_text.js";

const DURATION_S = 2;
const HINT = "Drag to turn, shift-drag for one lamp to move, + and − to zoom.";
const KEYS =
  "Arrow keys turn the object, shift and arrow keys move the lamp, plus and minus zoom, Enter touches the middle.";

const BLOWS = [[0.01, "Soft"], [0.05, "Medium"], [0.25, "Hard"]];  // newton seconds
const shownImpulse = (value) => `${Number((value * 1000).toPrecision(3))} mN s`;
const millimetres = (value) => `${value.toFixed(2)} mm`;
const degrees = (value) => `${Math.round(value)}°`;

class Panel {
  // `object`: facts, attach(canvas), draw(orbit, moving, shown), strike(...) and, where it can, press(...).
  constructor(place, object) {
    this.object = object;
    this.orbit = new Orbit(object.facts.frame, object.facts.reach);
    this.settings = { tool: "strike", impulse: 0.05, along: "normal", depth: 1, tilt: 0, azimuth: 0 };
    this.last = {};
    this.resolution = 128;
    this.file = object.facts.file;
    place.replaceChildren(this._stage(), this._side(), this._python());
    object.attach(this.canvas);
    gestures(this.canvas, {
      turn: (across, up) => this._moved(() => this.orbit.turn(across, up)),
      lamp: (across, up) => {
        this._lit("lamp");
        this._moved(() => this.orbit.moveLamp(across, up));
      },
      zoom: (factor) => this._moved(() => this.orbit.zoom(factor)),
      rest: () => this.redraw(false),
      act: (x, y, time) => this.act(x, y, time),
    });
    this._toolChosen("strike");
    this._lit("studio");
    new ResizeObserver(() => this.redraw(false)).observe(this.canvas);
  }

  _stage() {
    this.canvas = element("canvas", {
      width: 128, height: 128, tabindex: 0, role: "application", class: "player-image",
      "aria-label": `${this.object.facts.name}. ${KEYS}`,
    });
    this.ring = element("span", { class: "player-ring", hidden: true, "aria-hidden": "true" });
    const cross = element("span", { class: "player-cross", "aria-hidden": "true" });
    this.resolutionNote = element("span", { class: "player-resolution", "aria-hidden": "true" });
    const button = (text, label, act) =>
      element("button", { type: "button", "aria-label": label, title: label, onclick: act }, text);
    const zoom = (factor) => () => {
      this.orbit.zoom(factor);
      this.redraw(false);
    };
    return element(
      "div", { class: "player-stage" },
      element("div", { class: "player-frame" }, this.canvas, this.ring, cross, this.resolutionNote),
      element(
        "div", { class: "player-under" }, element("span", {}, HINT),
        button("−", "Farther", zoom(1.12)), button("+", "Nearer", zoom(1 / 1.12)),
        button("↺", "View as at first", () => this._home()),
      ),
    );
  }

  _side() {
    const set = (name) => (value) => (this.settings[name] = value);
    const lamp = (name) => (value) => this._moved(() => (this.orbit.lamp[name] = value), true);
    this.lampAcross = slider("Lamp, round", {
      low: -180, high: 180, step: 1, value: this.orbit.lamp.across, shown: degrees, changed: lamp("across"),
    });
    this.lampUp = slider("Lamp, up", {
      low: -90, high: 90, step: 1, value: this.orbit.lamp.up, shown: degrees, changed: lamp("up"),
    });
    this.lampControls = element(
      "div", { class: "player-controls" }, this.lampAcross.label, this.lampUp.label,
      element("p", { class: "player-note" }, "One lamp in a black room, as in the data."),
    );
    this.light = choice("Light", [["studio", "Studio"], ["window", "Window"], ["lamp", "One lamp"]], "studio", (kind) => {
      this._lit(kind);
      this.redraw(false);
    });
    for (const { input } of [this.lampAcross, this.lampUp]) input.addEventListener("change", () => this.redraw(false));
    const direction = element(
      "select", { onchange: (event) => (this.settings.along = event.target.value) },
      ...DIRECTIONS.map(([value, text]) => element("option", { value }, text)),
    );
    this.strikeControls = element(
      "div", { class: "player-controls" },
      choice(
        "Strength", BLOWS.map(([impulse, name]) => [impulse, `${name} ${shownImpulse(impulse)}`]),
        this.settings.impulse, set("impulse"),
      ),
      element("label", { class: "player-select" }, element("span", {}, "Direction"), direction),
    );
    const again = () => this.last.hit && this._touch(this.last.hit.x, this.last.hit.y, this.last.hit.orbit);
    const pressing = (name, text, low, high, step, shown) => {
      const made = slider(text, { low, high, step, value: this.settings[name], shown, changed: set(name) });
      made.input.addEventListener("change", again);
      return made.label;
    };
    this.pressControls = element(
      "div", { class: "player-controls" },
      pressing("depth", "Depth", 0.1, 2, 0.05, millimetres),
      pressing("tilt", "Tilt", 0, 15, 1, degrees),
      pressing("azimuth", "Towards", 0, 360, 5, degrees),
    );
    const name = this.object.facts.id ?? "object";
    const save = (text, act) => element("button", { type: "button", onclick: act }, text);
    this.saveSound = save("Save sound (WAV)", () => saved(this._wav(), `${name}.wav`));
    this.saveSound.disabled = true;
    const tools = [["strike", "Strike"]].concat(this.object.press ? [["press", "Press"]] : []);
    this.answer = element("div", { class: "player-answer" });
    this.said = element("p", { class: "player-said", role: "status", "aria-live": "polite" });
    const touchMiddle = element(
      "button", { type: "button", class: "player-act", onclick: (event) => this.act(0.5, 0.5, event.timeStamp) }, "",
    );
    this.actButton = touchMiddle;
    return element(
      "div", { class: "player-side" },
      tools.length > 1 ? choice("A click will", tools, "strike", (tool) => this._toolChosen(tool)) : null,
      this.strikeControls, this.pressControls,
      this.light, this.lampControls, touchMiddle, this.said,
      element("div", { class: "player-saves" }, save("Save picture (PNG)", () => this._picture()), this.saveSound),
      this.answer,
    );
  }

  _python() {
    this.code = element("code", {});
    const copy = element("button", { type: "button", onclick: () => this._copy(copy) }, "Copy");
    const code = element("pre", { tabindex: 0, role: "region", "aria-label": "Python of this query" }, this.code);
    return element(
      "div", { class: "player-more" },
      element("details", { class: "player-python" }, element("summary", {}, "The same in Python"), element("div", {}, copy, code)),
      this.object.facts.note ? element("p", { class: "player-note" }, this.object.facts.note) : null,
    );
  }

  _toolChosen(tool) {
    this.settings.tool = tool;
    this.strikeControls.hidden = tool !== "strike";
    this.pressControls.hidden = tool !== "press" || Boolean(this.object.facts.pressDepth);
    this.actButton.textContent = tool === "strike" ? "Strike the middle" : "Press the middle";
    this.answer.replaceChildren();
    const silent = !this.object.facts.frequencies.length;
    this.said.textContent =
      tool === "press" ? "Click the object to press the sensor there."
      : silent ? "This object has no mode that can be heard: a blow is silent."
      : "Click the object to strike it there.";
  }

  _lit(kind) {
    this.orbit.studio = kind === "lamp" ? null : kind;
    this.lampControls.hidden = kind !== "lamp";
    this.light.querySelector(`[value="${kind}"]`).checked = true;
  }

  _picture() {
    this.canvas.toBlob((png) => saved(png, `${this.object.facts.id ?? "object"}.png`));
  }

  // What was played last, as it was heard.
  _wav() {
    const { buffer, played } = this.heard;
    return wavOf(buffer.getChannelData(0), Math.round(buffer.sampleRate), played);
  }

  _home() {
    this.orbit.reset();
    this._lit("studio");
    this._moved(() => {}, false);
    this.redraw(false);
  }

  _moved(change, fromSlider = false) {
    change();
    if (!fromSlider) {
      this.lampAcross.set(Math.round(this.orbit.lamp.across));
      this.lampUp.set(Math.round(this.orbit.lamp.up));
    }
    this.redraw(true);
  }

  redraw(moving) {
    this.object.draw(this.orbit, moving, ({ resolution, note }) => {
      this.resolution = resolution;
      this.resolutionNote.textContent = note ?? "";
      this._placeRing();
      this._writePython();
    });
    this._placeRing();
  }

  _placeRing() {
    const { hit } = this.last;
    this.ring.hidden = !hit;
    if (!hit) return;
    const [x, y] = this.orbit.project(hit.point);
    this.ring.hidden = !(x > 0 && x < 1 && y > 0 && y < 1);
    this.ring.style.left = `${clamp(x, 0, 1) * 100}%`;
    this.ring.style.top = `${clamp(y, 0, 1) * 100}%`;
  }

  // Strikes or presses where the ray through (x, y) of the image meets the object.
  async act(x, y, time = performance.now()) {
    const orbit = Object.assign(new Orbit(this.orbit.frame, this.orbit.reach), {
      ...this.orbit, lamp: { ...this.orbit.lamp },
    });
    this.acted = time;
    await this._touch(x, y, orbit);
  }

  async _touch(x, y, orbit) {
    try {
      if (this.settings.tool === "strike") await this._strike(x, y, orbit);
      else await this._press(x, y, orbit);
    } catch (error) {
      this.said.textContent = error.message;
    }
    this._placeRing();
    this._writePython();
  }

  async _strike(x, y, orbit) {
    const { facts } = this.object;
    const { impulse, along } = this.settings;
    const asked = { impulse, along, duration: DURATION_S, sampleRate: audioContext().sampleRate };
    const answer = await this.object.strike(orbit, x, y, asked);
    if (!answer) return this._missed();
    const { sampleRate } = answer; // a stored object has its own
    const { played, peak, quieter, buffer } = play(answer.sound, sampleRate, facts.listeningGain);
    if (buffer) this.heard = { buffer, played };
    const waited = performance.now() - this.acted;
    this.saveSound.disabled = !peak;
    const amplitudes = await answer.partials();
    this.last = {
      hit: { x, y, orbit, point: answer.point },
      strike: { point: answer.point, normal: answer.normal, impulse: answer.impulse, duration: DURATION_S, sample_rate: sampleRate },
    };
    const found = partials(facts.frequencies, facts.dampings, amplitudes, sampleRate);
    this.answer.replaceChildren(...(found.length ? [spectrum(found), partialsTable(found)] : []));
    const loud = `${shownImpulse(asked.impulse)}; peak ${peak.toPrecision(3)} m/s`;
    this.said.textContent = found.length
      ? `Struck with ${loud}, played × ${played.toPrecision(2)}${quieter ? ", turned down to fit" : ""}.`
      : `Struck with ${loud}: no mode that can be heard.`;
    this.canvas.dispatchEvent(new CustomEvent("player:struck", { bubbles: true, detail: { answer: { ...answer, amplitudes }, waited } }));
    return undefined;
  }

  async _press(x, y, orbit) {
    const { depth, tilt, azimuth } = this.settings;
    const fixed = this.object.facts.pressDepth; // where presses are stored
    const asked = fixed ? { depth: fixed, tilt: 0, azimuth: 0 } : { depth: depth / 1000, tilt, azimuth };
    const answer = await this.object.press(orbit, x, y, asked);
    if (!answer) return this._missed();
    this.last = { hit: { x, y, orbit, point: answer.point }, press: { ...asked, point: answer.point, normal: answer.normal } };
    this.answer.replaceChildren(
      element("div", { class: "player-touch" }, ...answer.pictures.map(([image, name]) =>
        element("figure", {}, picture(image, name), element("figcaption", {}, name)))),
    );
    this.said.textContent = answer.said;
    this.canvas.dispatchEvent(new CustomEvent("player:pressed", { bubbles: true, detail: { answer } }));
    return undefined;
  }

  say(text) {
    this.said.textContent = text;
  }

  _missed() {
    this.say("There is nothing of the object there.");
  }

  _writePython() {
    const view = {
      camera_to_world: this.orbit.cameraToWorld(), light_position: this.orbit.lightPosition(), studio: this.orbit.studio, resolution: this.resolution,
    };
    const { strike, press } = this.last;
    this.code.textContent = pythonText({ file: this.file, view, strike, press });
  }

  async _copy(button) {
    try {
      await navigator.clipboard.writeText(this.code.textContent);
      button.textContent = "Copied";
    } catch {
      // A page from disk may not reach the clipboard: the text is selected instead.
      getSelection().selectAllChildren(this.code);
      button.textContent = "Selected: press Ctrl+C";
    }
    setTimeout(() => (button.textContent = "Copy"), 2000);
  }
}

export const mount = (place, object) => (place.objectfolderPanel = new Panel(place, object));
