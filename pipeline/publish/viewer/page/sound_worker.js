// Takes sound as it comes and hands it to the player, beside the thread of the page, which images keep busy.
import { answers } from "./asking.js";

let player = null;
let running = false;

async function listen() {
  for await (const { header, payload } of answers("heard", { since: 0 })) {
    const pascals = new Float32Array(payload);
    const peak = pascals.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
    if (peak || header.said) self.postMessage({ peak, said: header.said });
    if (running && pascals.length) player.postMessage(pascals, [pascals.buffer]);
  }
}

self.onmessage = ({ data }) => {
  running = data.running;
  if (!data.player) return;
  player = data.player;
  listen().catch((error) => self.postMessage({ failed: error.message }));
};
