// The page of `objectfolder play`: a table whose objects one strikes, carries and squeezes.
import { dot, minus, plus, times } from "./algebra.js";
import { ask, paint } from "./asking.js";
import { element, saved, slider } from "./elements.js";
import { gestures } from "./gestures.js";
import { Orbit } from "./orbit.js";
import { SoundStream } from "./sound_stream.js";

// Sides of images that move: a smaller one after one that was slow to draw, a larger one after a quick one.
const [SIDES, SLOW_MS, QUICK_MS] = [[128, 192, 256], 40, 15];
// Shown one after the other while nothing moves: only what has moved since is drawn again.
const RESTING = [{ resolution: 512, draft: true }, { resolution: 512, sub_rays: 16 }];
const FELT_MS = 80;
const RECORDED_MS = 500;
const CARRIED_MS = 15;
const LIFTED_M = 0.1;
const THROWN_M_S = 1.5;
const LIFTING_M_S = 0.05;
const TITLE = "A table of Object Files";
const HINT =
  "Click an object to strike it, drag it to push, lift and throw it. Drag beside it to turn the view, scroll to zoom.";
const DECIBELS = { low: -40, high: 20, step: 1, value: -8 };

const place = document.getElementById("player");
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
// Images that come faster than they are painted would only keep the page busy.
const painted = () => new Promise((done) => requestAnimationFrame(done));
const gain = (decibels) => 10 ** (decibels / 20);

class Table {
  constructor(facts) {
    this.facts = facts;
    this.orbit = new Orbit(facts.frame, 1);
    Object.assign(this.orbit, { azimuth: -81, elevation: 33 });
    this.sound = new SoundStream(facts.rate, gain(DECIBELS.value));
    Object.assign(this, { stamp: -1, turned: 0, stage: 0, fineness: 0, hand: false, carried: null, impulse: 0.05, force: 4 });
    this.build();
  }

  build() {
    const { bodies, gel } = this.facts;
    this.canvas = element("canvas", {
      class: "player-image", tabindex: 0, role: "application",
      "aria-label": "The table. Arrow keys turn it, plus and minus zoom, Enter strikes what is in the middle.",
    });
    this.context = this.canvas.getContext("2d");
    this.note = element("span", { class: "player-resolution" });
    this.rings = [0, 1].map(() => element("div", { class: "player-ring", hidden: true }));
    this.frame = element("div", { class: "player-frame" }, this.canvas, element("div", { class: "player-cross" }), ...this.rings, this.note);
    this.chosen = element("select", {}, ...bodies.map(({ body, name }) => element("option", { value: body }, name)));
    const button = (name, act) => element("button", { type: "button", onclick: () => this.try(act) }, name);
    const body = () => ({ body: this.chosen.value });
    this.recording = button("Record clip", () => this.record());
    this.said = element("p", { class: "player-said", role: "status" });
    this.gels = ["Left finger", "Right finger"].map((name) => {
      const canvas = element("canvas", { width: gel[1], height: gel[0], role: "img", "aria-label": `${name}: image of the gel` });
      const caption = element("figcaption", {}, name);
      return { name, canvas, caption, figure: element("figure", {}, canvas, caption) };
    });
    this.pair = element("div", { class: "player-touch", hidden: true }, ...this.gels.map(({ figure }) => figure));
    const impulse = slider("Impulse", {
      low: 5, high: 300, step: 5, value: 50, shown: (now) => `${now} mN s`, changed: (now) => (this.impulse = now / 1000),
    });
    const force = slider("Squeeze", {
      low: 0.5, high: 10, step: 0.5, value: this.force, shown: (now) => `${now} N`,
      changed: (now) => this.try(() => ((this.force = now), this.hand && this.grip(0))),
    });
    this.volume = slider("Volume", { ...DECIBELS, shown: (now) => `${now} dB`, changed: (now) => this.louder(now) });
    place.replaceChildren(
      element("div", { class: "player-stage" }, this.frame),
      element(
        "div", { class: "player-side" },
        element("label", { class: "player-select" }, element("span", {}, "Object"), this.chosen),
        element(
          "div", { class: "player-saves" },
          button("Strike", () => this.act("strike", { ...body(), impulse: this.impulse })),
          button("Lift and drop", () => this.act("lift", { ...body(), height: LIFTED_M })),
          button("Throw", () => this.throwAway(body())),
        ),
        element(
          "div", { class: "player-saves" },
          button("Squeeze", () => this.squeeze(body())),
          button("Lift it", () => this.grip(LIFTING_M_S)),
          button("Lower it", () => this.grip(-LIFTING_M_S)),
          button("Let go", () => this.open()),
        ),
        element("div", { class: "player-controls" }, impulse.label, force.label, this.volume.label),
        element("div", { class: "player-saves" }, button("Save picture", () => this.savePicture()), this.recording),
        this.said, this.pair,
      ),
    );
    for (const kind of ["pointerdown", "keydown"]) document.addEventListener(kind, () => this.sound.resume());
    gestures(this.canvas, {
      turn: (across, up) => this.look(() => this.orbit.turn(across, up)),
      zoom: (factor) => this.look(() => this.orbit.zoom(factor)),
      lamp: () => {},
      rest: () => {},
      act: (x, y) => this.try(() => this.strike(x, y)),
      grab: (x, y) => this.grab(x, y),
      pull: (x, y) => this.pull(x, y),
      drop: () => this.drop(),
    });
  }

  savePicture() {
    this.canvas.toBlob((png) => saved(png, "table.png"));
  }

  // Records what is seen and heard until it is asked for again, then saves it.
  record() {
    if (this.recorder) return this.recorder.stop();
    const heard = this.sound.recorded();
    const stream = new MediaStream([...this.canvas.captureStream().getTracks(), ...heard.stream.getTracks()]);
    const type = ["video/mp4", "video/webm"].find((known) => MediaRecorder.isTypeSupported(known));
    const recorder = new MediaRecorder(stream, { mimeType: type });
    const parts = [];
    recorder.ondataavailable = ({ data }) => parts.push(data);
    recorder.onstop = () => {
      saved(new Blob(parts, { type }), `table.${type.slice("video/".length)}`);
      heard.end();
      this.recorder = null;
      this.recording.textContent = "Record clip";
    };
    recorder.start(RECORDED_MS);
    this.recorder = recorder;
    this.recording.textContent = "Stop and save clip";
  }

  // The image's size, how often sound came too late so far, and how late it is played since.
  tell() {
    const { side, sound: { underruns, behind } } = this;
    if (!side) return;
    const gaps = `${underruns} gap${underruns > 1 ? "s" : ""} in the sound, now ${behind.toFixed(2)} s late`;
    this.note.textContent = `${side} × ${side}${underruns ? ` · ${gaps}` : ""}`;
  }

  say(text) {
    if (this.said.textContent !== text) this.said.textContent = text;
  }

  async try(act) {
    try {
      this.say("");
      await act();
    } catch (error) {
      this.say(error.message);
    }
  }

  louder(decibels) {
    this.sound.volume.gain.value = gain(decibels);
  }

  async act(act, asked = {}) {
    return (await ask("act", { act, ...asked })).header;
  }

  async strike(x, y) {
    const { missed, body } = await this.act("strike", { ...this.orbit.ray(x, y), impulse: this.impulse });
    if (missed) this.say("Nothing is there.");
    else this.chosen.value = body;
  }

  throwAway(body) {
    const { backward } = this.orbit.axes();
    return this.act("throw", { ...body, velocity: [-backward[0] * 0.5, -backward[1] * 0.5, THROWN_M_S] });
  }

  // What is under a place is known from the last image; where exactly, from the world.
  grab(x, y) {
    const { bodies, side } = this;
    if (!bodies || bodies[Math.floor(y * side) * side + Math.floor(x * side)] < 0) return false;
    const carried = { backward: this.orbit.axes().backward };
    this.carried = carried;
    this.try(async () => {
      const { missed, body, point } = await this.act("grab", this.orbit.ray(x, y));
      if (!missed) this.chosen.value = body;
      while (!missed && this.carried === carried) await this.follow(carried, point);
      await this.act("drop");
    });
    return true;
  }

  // Carried in the plane through the point that was grabbed, facing the camera, to the newest place of the pointer.
  async follow(carried, point) {
    const { at } = carried;
    carried.at = null;
    if (!at) return pause(CARRIED_MS);
    const { origin, direction } = this.orbit.ray(...at);
    const along = dot(minus(point, origin), carried.backward) / dot(direction, carried.backward);
    return this.act("pull", { target: plus(origin, times(direction, along)) });
  }

  pull(x, y) {
    if (this.carried) this.carried.at = [x, y];
  }

  drop() {
    this.carried = null;
  }

  async squeeze(body) {
    await this.act("squeeze", { ...body, across: this.orbit.axes().right, force: this.force, lifting: 0 });
    if (!this.hand) this.feel();
  }

  grip(lifting) {
    return this.act("grip", { force: this.force, lifting });
  }

  open() {
    this.hand = false;
    return this.act("open");
  }

  // Shows both fingers while they are there.
  async feel() {
    this.hand = true;
    this.pair.hidden = false;
    while (this.hand) {
      const { header, payload } = await ask("felt", {});
      const size = payload.byteLength / 2;
      header.forces.forEach(([normal, across], finger) => {
        const { canvas, caption, name } = this.gels[finger];
        paint(canvas.getContext("2d"), ...this.facts.gel, new Uint8Array(payload, finger * size, size));
        caption.textContent = `${name}: ${normal.toFixed(1)} N pressed, ${across.toFixed(1)} N across`;
      });
      if (header.said) this.say(header.said);
      await pause(FELT_MS);
    }
    this.pair.hidden = true;
  }

  show({ header, payload }, stage, turned) {
    if (turned !== this.turned) return;
    const side = header.resolution;
    const rgb = new Uint8Array(payload, 0, 3 * side ** 2);
    paint(this.context, side, side, rgb);
    Object.assign(this, { stamp: header.stamp, stage, bodies: new Int8Array(payload, 3 * side ** 2) });
    this.canvas.dataset.state = stage === RESTING.length ? "rest" : "moving";
    this.side = side;
    if (stage === 0) this.keepUp(header.drawn_ms);
    this.tell();
    this.rings.forEach((ring, finger) => {
      const at = header.fingers[finger];
      ring.hidden = !at;
      if (at) [ring.style.left, ring.style.top] = this.orbit.project(at).map((share) => `${100 * share}%`);
    });
  }

  seen(wanted, wait) {
    return ask("seen", { ...wanted, camera_to_world: this.orbit.cameraToWorld(), stamp: this.stamp, wait });
  }

  moving() {
    return { resolution: SIDES[this.fineness], draft: true };
  }

  keepUp(took) {
    if (took > SLOW_MS) this.fineness = Math.max(0, this.fineness - 1);
    else if (took < QUICK_MS) this.fineness = Math.min(SIDES.length - 1, this.fineness + 1);
  }

  // Shows the table from elsewhere at once, and nothing that was asked for before.
  look(turn) {
    turn();
    this.turned += 1;
    if (this.looking) return;
    this.looking = true;
    this.try(async () => {
      let turned = -1;
      while (turned !== this.turned) {
        turned = this.turned;
        this.show(await this.seen(this.moving(), false), 0, turned);
      }
    }).finally(() => (this.looking = false));
  }

  // Small images while something moves, larger ones while nothing does.
  async watch() {
    for (;;) {
      const { turned, stage } = this;
      const answer = await this.seen(this.moving(), true);
      if (!answer.header.still) {
        this.show(answer, 0, turned);
        await painted();
      } else if (stage < RESTING.length && !this.resting) this.rest(stage, turned);
    }
  }

  async rest(stage, turned) {
    this.resting = true;
    await this.try(async () => {
      const answer = await this.seen(RESTING[stage], false);
      if (answer.header.stamp === this.stamp) this.show(answer, stage + 1, turned);
    });
    this.resting = false;
  }

  listen() {
    const heard = ({ peak, said }) => {
      if (said) this.say(said);
      if (peak * this.sound.volume.gain.value > 1) {
        const fits = Math.floor(-20 * Math.log10(peak));
        this.volume.set(fits);
        this.louder(fits);
      }
    };
    return this.sound.listen({ heard, counted: () => this.tell() });
  }
}

try {
  const table = new Table((await ask("table", {})).header);
  place.objectfolderTable = table;
  const write = (id, text) => (document.getElementById(id).textContent = text);
  document.title = TITLE;
  write("name", TITLE);
  write("facts", HINT);
  const credits = table.facts.bodies.map(({ name, licence, attribution }) => [name, licence, attribution].filter(Boolean).join(", "));
  write("credit", credits.join(" · "));
  await Promise.race([table.watch(), table.listen()]).catch((error) => table.say(error.message));
} catch (error) {
  place.replaceChildren(element("p", { class: "player-wait", role: "alert" }, `The scene cannot be shown: ${error.message}`));
}
