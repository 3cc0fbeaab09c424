// The gains of modes at stored places, and the sound that they make.
"use strict";
(function (viewer) {
  // Modes nearer to half the sample rate than this would sound at another pitch (`synthesis.oscillators`).
  const HIGHEST_RATIO = 0.454;
  // A mode ends where it has fallen to this fraction.
  const FLOOR = 1e-6;

  class StoredModes {
    constructor(header, arrays, places) {
      const { eigenvalues, dampings_per_s } = header.sound;
      this.dampings = dampings_per_s;
      this.eigenvalues = eigenvalues;
      this.frequencies = eigenvalues.map((square, mode) =>
        Math.sqrt(Math.max(square - dampings_per_s[mode] ** 2, 0)) / (2 * Math.PI),
      );
      if (!eigenvalues.length) return;
      this.steps = header.sound.gain_steps;
      this.gains = arrays.gains;
      this.places = places;
    }

    // Velocity along the normal, m/s, that an impulse (newton seconds) gives each mode at a stored place.
    amplitudes(place, impulse) {
      const { normal } = this.places[place];
      return this.steps.map((step, mode) => {
        let [struck, moved] = [0, 0];
        for (let axis = 0; axis < 3; axis += 1) {
          const gain = step * this.gains[(mode * 3 + axis) * this.places.length + place];
          struck += gain * impulse[axis];
          moved += gain * normal[axis];
        }
        return struck * moved;
      });
    }

    // The velocity along the normal where it is struck, m/s, with all modes starting at t = 0.
    sound(amplitudes, duration, sampleRate) {
      const samples = new Float32Array(Math.round(duration * sampleRate));
      const total = new Float64Array(samples.length);
      amplitudes.forEach((amplitude, mode) => {
        if (this.frequencies[mode] > HIGHEST_RATIO * sampleRate || amplitude === 0) return;
        ring(total, amplitude, this.eigenvalues[mode], this.dampings[mode], sampleRate);
      });
      samples.set(total);
      return samples;
    }
  }

  // Adds a exp(-c t) (cos w t - c / w sin w t), or its forms without an oscillation, to `total`.
  function ring(total, amplitude, square, damping, sampleRate) {
    const discriminant = square - damping ** 2;
    const h = 1 / sampleRate;
    const motion = (t) => {
      if (discriminant > 0) {
        const w = Math.sqrt(discriminant);
        return Math.exp(-damping * t) * (Math.cos(w * t) - (damping / w) * Math.sin(w * t));
      }
      const spread = Math.sqrt(-discriminant);
      const fast = damping + spread;
      const slow = square / fast;
      if (spread < 1e-6 * damping) return (1 - damping * t) * Math.exp(-damping * t);
      return (fast * Math.exp(-fast * t) - slow * Math.exp(-slow * t)) / (fast - slow);
    };
    // Any such motion obeys x[n] = p x[n - 1] + q x[n - 2].
    const decay = Math.exp(-damping * h);
    const phase = Math.sqrt(Math.abs(discriminant)) * h;
    const p = 2 * decay * (discriminant > 0 ? Math.cos(phase) : Math.cosh(phase));
    const q = -decay * decay;
    const slowest = discriminant > 0 ? damping : square / (damping + Math.sqrt(-discriminant));
    const stop = Math.min(total.length, Math.ceil((-Math.log(FLOOR) / Math.max(slowest, 1e-9)) * sampleRate));
    let [before, now] = [amplitude * motion(-h), amplitude];
    for (let index = 0; index < stop; index += 1) {
      total[index] += now;
      [before, now] = [now, p * now + q * before];
    }
  }

  viewer.StoredModes = StoredModes;
})((window.objectfolderViewer ??= {}));
