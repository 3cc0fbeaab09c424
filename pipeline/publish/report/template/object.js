// One held-out query at a time, the difference drawn from the two pictures on the page, or all three taken from
// the sheet beside the page, and sounds by a button.
import { wavOf } from "./listening.js";
import { RATE, factsOf, load, soundsOf } from "./strikes.js";

const GREY = 128;
const FACTORS = [1, 2, 4, 8, 16, 32];
const SHEET_FACTOR = 8; // of the differences on a sheet
let factor = SHEET_FACTOR;

const pixels = (image) => {
  const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight);
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, canvas.width, canvas.height);
};

const drawDifference = async (query) => {
  const canvas = query.querySelector("canvas.difference");
  if (canvas && query.dataset.sheet) canvas.style.filter = `contrast(${factor / SHEET_FACTOR})`;
  if (!canvas || query.dataset.sheet || canvas.dataset.factor === String(factor)) return;
  const [truth, answer] = [query.querySelector(".truth"), query.querySelector(".answer")];
  await Promise.all([truth.decode(), answer.decode()]);
  const [wanted, given] = [pixels(truth), pixels(answer)];
  const drawn = new ImageData(wanted.width, wanted.height);
  for (let i = 0; i < wanted.data.length; i += 1) {
    drawn.data[i] = i % 4 === 3 ? 255 : GREY + factor * (given.data[i] - wanted.data[i]);
  }
  canvas.getContext("2d").putImageData(drawn, 0, 0);
  canvas.dataset.factor = String(factor);
};

const stopAll = () => {
  for (const audio of document.querySelectorAll("audio")) audio.pause();
};

const drawSheet = async (query, row) => {
  query.dataset.row = row;
  query.picture ??= Object.assign(new Image(), { src: query.dataset.sheet });
  await query.picture.decode();
  if (query.dataset.row !== String(row)) return; // another was chosen meanwhile
  for (const [place, canvas] of query.querySelectorAll("canvas").entries()) {
    const { width, height } = canvas;
    const context = canvas.getContext("2d");
    context.drawImage(query.picture, place * width, row * height, width, height, 0, 0, width, height);
  }
  query.dataset.drawn = row;
};

const listFacts = (query, facts) => {
  query.querySelector(".row").replaceChildren(
    ...facts.map(([name, value, unit]) => {
      const item = document.createElement("li");
      const [label, measured] = ["soft", "unit"].map((kind) =>
        Object.assign(document.createElement("span"), { className: kind }),
      );
      label.textContent = name;
      measured.textContent = unit;
      item.append(label, ` ${value} `, measured);
      return item;
    }),
  );
};

const drawStrike = async (query, rank) => {
  query.dataset.rank = rank;
  query.loaded ??= load(query.dataset.strikes);
  const strikes = await query.loaded.catch(({ message }) => {
    query.querySelector(".row").textContent = message;
  });
  if (!strikes || query.dataset.rank !== String(rank)) return; // another was chosen meanwhile
  const { gain, sounds, pictures } = soundsOf(strikes, rank);
  listFacts(query, factsOf(strikes, rank));
  query.querySelector(".gain").textContent = gain.toPrecision(3);
  for (const [which, figure] of query.querySelectorAll("figure").entries()) {
    figure.querySelector("svg image").setAttribute("href", pictures[which]);
    const audio = figure.querySelector("audio");
    if (!audio) continue;
    URL.revokeObjectURL(audio.src);
    audio.removeAttribute("src");
    audio.sound = sounds[which];
  }
  query.dataset.drawn = rank;
};

const showContact = (query, contact) => {
  const set = (part, values) => {
    for (const [name, value] of Object.entries(values)) query.querySelector(part).setAttribute(name, value);
  };
  const [[x, y], [x1, y1]] = [contact.spot, contact.arrow];
  const hidden = contact.visible ? "" : "; the contact is hidden behind the surface";
  set("svg", { "aria-label": `The object with the contact of this touch marked${hidden}` });
  set("svg image", { y: -contact.side * query.querySelector("svg image").getAttribute("width") });
  set(".gel", { points: contact.gel });
  set(".arrow", { x1, y1, x2: x, y2: y });
  set(".spot", { cx: x, cy: y, class: contact.visible ? "spot" : "spot hidden" });
};

const strikeOf = (query, rank) => {
  query.dataset.place = { 0: "worst", [query.dataset.audible - 1]: "best" }[rank] ?? "";
  drawStrike(query, rank);
  return query;
};

// The query of a rank, filled in where it does not stand on the page.
const queryOf = (sense, rank) => {
  const strikes = sense.querySelector(".query.strikes");
  if (strikes) return strikeOf(strikes, rank);
  const own = sense.querySelector(`.query[data-rank="${rank}"]`);
  if (own) return own;
  const query = sense.querySelector(".query[data-sheet]");
  query.known ??= JSON.parse(query.querySelector("script").textContent);
  const { place, row, facts, contact } = query.known[rank];
  query.dataset.place = place;
  listFacts(query, facts);
  if (contact) showContact(query, contact);
  drawSheet(query, row);
  return query;
};

const show = (sense) => {
  const slider = sense.querySelector("input[type=range]");
  const chosen = queryOf(sense, Number(slider.value) - 1);
  for (const query of sense.querySelectorAll(".query")) query.hidden = query !== chosen;
  const { place } = chosen.dataset;
  const text = `${slider.value} of ${slider.max}${place ? `: ${place}` : ""}`;
  slider.setAttribute("aria-valuetext", text);
  sense.querySelector(".choose output").textContent = text;
  drawDifference(chosen);
};

const addFactors = (sense) => {
  if (!sense.querySelector("canvas")) return;
  const label = document.createElement("label");
  const select = document.createElement("select");
  select.className = "factor";
  for (const value of FACTORS) select.append(new Option(`× ${value}`, String(value)));
  select.value = String(factor);
  label.append("Difference ", select);
  sense.querySelector(".choose").append(label);
  select.addEventListener("change", () => {
    factor = Number(select.value);
    for (const other of document.querySelectorAll("select.factor")) other.value = select.value;
    for (const query of document.querySelectorAll(".query:not([hidden])")) drawDifference(query);
  });
};

const addPlayer = (figure) => {
  const [button, audio, head] = ["button", "audio", ".playhead"].map((part) => figure.querySelector(part));
  const picture = figure.querySelector("svg image");
  const [left, width] = ["x", "width"].map((name) => Number(picture.getAttribute(name)));
  const move = () => {
    const place = left + width * Math.min(1, audio.currentTime / 0.5);
    head.setAttribute("x1", place);
    head.setAttribute("x2", place);
    if (!audio.paused) requestAnimationFrame(move);
  };
  button.setAttribute("aria-pressed", "false");
  button.addEventListener("click", () => {
    const again = audio.paused;
    stopAll();
    if (!again || !audio.sound) return;
    if (!audio.src) audio.src = URL.createObjectURL(wavOf(audio.sound, RATE));
    audio.currentTime = 0;
    audio.play();
  });
  const playing = (now) => {
    button.setAttribute("aria-pressed", String(now));
    head.classList.toggle("moving", now);
    if (now) move();
  };
  audio.addEventListener("play", () => playing(true));
  audio.addEventListener("pause", () => playing(false));
  audio.addEventListener("ended", () => playing(false));
};

for (const sense of document.querySelectorAll(".sense")) {
  const slider = sense.querySelector(".choose input");
  if (!slider) continue;
  addFactors(sense);
  slider.value = slider.defaultValue; // the median
  slider.addEventListener("input", () => {
    stopAll();
    show(sense);
  });
  sense.querySelector(".choose .worst").addEventListener("click", () => {
    slider.value = "1";
    slider.dispatchEvent(new Event("input"));
  });
  for (const audio of sense.querySelectorAll("audio")) addPlayer(audio.closest("figure"));
  show(sense);
}
