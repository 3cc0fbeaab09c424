"use strict";
// One held-out query at a time, the difference drawn from the two pictures on the page, and sounds by a button.
(() => {
  const GREY = 128;
  const FACTORS = [1, 2, 4, 8, 16, 32];
  let factor = 8;

  const pixels = (image) => {
    const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight);
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, canvas.width, canvas.height);
  };

  const drawDifference = async (query) => {
    const canvas = query.querySelector("canvas");
    if (!canvas || canvas.dataset.factor === String(factor)) return;
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

  const show = (sense) => {
    const slider = sense.querySelector("input[type=range]");
    const queries = [...sense.querySelectorAll(".query")];
    const chosen = queries[Number(slider.value) - 1];
    for (const query of queries) query.hidden = query !== chosen;
    const text = `${slider.value} of ${queries.length}: ${chosen.dataset.place}`;
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
    audio.controls = false;
    button.hidden = false;
    button.setAttribute("aria-pressed", "false");
    button.addEventListener("click", () => {
      const again = audio.paused;
      stopAll();
      if (!again) return;
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
    slider.value = "1";
    slider.addEventListener("input", () => {
      stopAll();
      show(sense);
    });
    for (const audio of sense.querySelectorAll("audio")) addPlayer(audio.closest("figure"));
    show(sense);
  }
})();
