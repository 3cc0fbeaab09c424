"use strict";
// What an ABX test is, apart from the page: which sound is A and which X, and how likely a score is by guessing.

// Mulberry32: a small generator whose numbers are the same in every browser, for the same 32-bit seed.
function generator(seed) {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let value = Math.imul(state ^ (state >>> 15), state | 1);
    value ^= value + Math.imul(value ^ (value >>> 7), value | 61);
    return ((value ^ (value >>> 14)) >>> 0) / 4294967296;
  };
}

// The trials of a seed: pairs in random order; for each a coin says which sound is A, another which is X.
function planTrials(pairs, seed) {
  const chance = generator(seed);
  const order = pairs.map((_, index) => index);
  for (let last = order.length - 1; last > 0; last -= 1) {
    const other = Math.floor(chance() * (last + 1));
    [order[last], order[other]] = [order[other], order[last]];
  }
  return order.map((pair) => ({
    pair,
    a: chance() < 0.5 ? "truth" : "object_file",
    x: chance() < 0.5 ? "a" : "b",
  }));
}

// Probability of at least this number of right answers by tossing coins.
function guessProbability(correct, total) {
  let term = 0.5 ** total;
  let sum = 0;
  for (let count = total; count >= correct; count -= 1) {
    sum += term;
    term *= count / (total - count + 1);
  }
  return Math.min(1, sum);
}
