"use strict";
// The page of the test: plays the sounds, takes the answers, keeps the record.
document.addEventListener("DOMContentLoaded", () => {
  const test = JSON.parse(document.getElementById("test").textContent);
  const part = (id) => document.getElementById(id);
  const plays = { a: part("play-a"), b: part("play-b"), x: part("play-x") };
  const answers = { a: part("is-a"), b: part("is-b") };
  let audio = null;
  let playing = null;
  let trials = [];
  let records = [];
  let current = null;
  let seed = 0;
  let startedAt = null;

  const stated = new URLSearchParams(location.hash.slice(1)).get("seed");
  part("seed").value = /^\d{1,9}$/.test(stated ?? "") ? stated : String(test.seed);

  function samples(base64) {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const levels = new DataView(bytes.buffer);
    return Float32Array.from({ length: bytes.length / 2 }, (_, index) => levels.getInt16(2 * index, true) / 32768);
  }

  // The sound behind a letter of the current trial.
  function soundOf(letter) {
    const role = letter === "x" ? current.x : letter;
    const isTruth = (current.a === "truth") === (role === "a");
    return test.pairs[current.pair][isTruth ? "truth" : "object_file"];
  }

  function play(letter) {
    if (!current) return;
    audio ??= new AudioContext({ sampleRate: test.sample_rate_hz });
    audio.resume();
    playing?.stop();
    const values = samples(soundOf(letter));
    const buffer = audio.createBuffer(1, values.length, test.sample_rate_hz);
    buffer.copyToChannel(values, 0);
    playing = audio.createBufferSource();
    playing.buffer = buffer;
    playing.connect(audio.destination);
    playing.start();
    current.plays[letter] += 1;
    plays[letter].dataset.heard = "";
    allowAnswers();
  }

  function allowAnswers() {
    const all = Object.values(current.plays).every((count) => count > 0);
    for (const button of Object.values(answers)) button.disabled = !all;
    part("hint").textContent = all ? "Which of the two is X?" : "Hear A, B and X at least once.";
  }

  function show(number) {
    current = { ...trials[number], number: number + 1, plays: { a: 0, b: 0, x: 0 }, since: performance.now() };
    part("number").textContent = `Trial ${current.number} of ${trials.length}`;
    part("progress").value = number;
    for (const button of Object.values(plays)) delete button.dataset.heard;
    allowAnswers();
    part("number").focus();
  }

  function answer(letter) {
    if (!current || answers[letter].disabled) return;
    playing?.stop();
    const { object_id, query, level_change_db, truth_fingerprint, object_file_fingerprint } = test.pairs[current.pair];
    records.push({
      number: current.number,
      object_id,
      query,
      a: current.a,
      b: current.a === "truth" ? "object_file" : "truth",
      x: current.x,
      answer: letter,
      correct: letter === current.x,
      plays: current.plays,
      seconds: Math.round(performance.now() - current.since) / 1000,
      level_change_db,
      truth_fingerprint,
      object_file_fingerprint,
    });
    if (records.length < trials.length) show(records.length);
    else finish();
  }

  function result() {
    const correct = records.filter((record) => record.correct).length;
    return {
      format: "objectfolder-abx",
      format_version: 1,
      software: test.software,
      page_seed: test.seed,
      seed,
      participant: part("participant").value,
      started: startedAt,
      sample_rate_hz: test.sample_rate_hz,
      level_rule: test.level_rule,
      trials: records,
      correct,
      total: records.length,
      p_value: guessProbability(correct, records.length),
    };
  }

  function finish() {
    const done = result();
    current = null;
    part("trial").hidden = true;
    part("result").hidden = false;
    part("score").textContent = `${done.correct} of ${done.total} right`;
    const probability = done.p_value < 0.001 ? "less than 0.001" : done.p_value.toFixed(3);
    part("meaning").textContent =
      `Somebody who hears no difference gets at least this number right with a probability of ${probability}; ` +
      `${done.total / 2} would be expected.`;
    const byObject = new Map();
    for (const record of records) {
      const [right, all] = byObject.get(record.object_id) ?? [0, 0];
      byObject.set(record.object_id, [right + Number(record.correct), all + 1]);
    }
    part("by-object").replaceChildren(
      ...[...byObject].sort().map(([object, [right, all]]) => {
        const row = document.createElement("tr");
        const name = document.createElement("th");
        name.scope = "row";
        name.textContent = object;
        const count = document.createElement("td");
        count.textContent = `${right} of ${all}`;
        row.append(name, count);
        return row;
      }),
    );
    part("result-heading").focus();
  }

  part("start").addEventListener("submit", (event) => {
    event.preventDefault();
    seed = Number(part("seed").value);
    trials = planTrials(test.pairs, seed);
    records = [];
    startedAt = new Date().toISOString();
    part("intro").hidden = true;
    part("trial").hidden = false;
    show(0);
  });
  part("download").addEventListener("click", () => {
    const link = document.createElement("a");
    const text = `${JSON.stringify(result(), null, 1)}\n`;
    link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    link.download = `abx-${seed}.json`;
    link.click();
    URL.revokeObjectURL(link.href);
  });
  for (const [letter, button] of Object.entries(plays)) button.addEventListener("click", () => play(letter));
  for (const [letter, button] of Object.entries(answers)) button.addEventListener("click", () => answer(letter));
  document.addEventListener("keydown", (event) => {
    if (!current || event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
    const key = event.key.toLowerCase();
    if (key in plays) play(key);
    else if (key === "1") answer("a");
    else if (key === "2") answer("b");
    else return;
    event.preventDefault();
  });
});
