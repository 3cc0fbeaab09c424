// The gains of modes at a place, from those stored at others, and the sound that they make.
"use strict";
(function (viewer) {
  // Stored places that an answer is made of, and what keeps their equations regular.
  const NEIGHBOURS = 64;
  const RIDGE = 1e-5;
  // Modes nearer to half the sample rate than this would sound at another pitch (`synthesis.oscillators`).
  const HIGHEST_RATIO = 0.454;
  // A mode ends where it has fallen to this fraction.
  const FLOOR = 1e-6;

  class StoredModes {
    constructor(header, arrays, surface) {
      const { eigenvalues, dampings_per_s } = header.sound;
      this.dampings = dampings_per_s;
      this.eigenvalues = eigenvalues;
      this.frequencies = eigenvalues.map((square, mode) =>
        Math.sqrt(Math.max(square - dampings_per_s[mode] ** 2, 0)) / (2 * Math.PI),
      );
      if (!eigenvalues.length) return;
      this.kernel = header.sound.kernel;
      this.steps = header.sound.gain_steps;
      this.surface = surface;
      this.gains = arrays.gains;
      // What is added at vertices, linear across faces.
      this.corrections = arrays.corrections;
      this.correctionSteps = header.sound.correction_steps;
      this.corrected = new Map(Array.from(arrays.corrected, (vertex, row) => [vertex, row]));
      this._features(header, arrays);
      const places = arrays.control_faces;
      this.count = places.length;
      this.width = 6 + header.sound.detour_dimensions;
      this.places = new Float64Array(this.count * this.width);
      for (let place = 0; place < this.count; place += 1) {
        const [first, second] = [0, 1].map((at) => arrays.control_barycentric[2 * place + at] / 255);
        this.places.set(this._at(places[place], [first, second, 1 - first - second]), place * this.width);
      }
    }

    // Normal, position and detours of each vertex, scaled so that their distances are those of the covariance.
    _features(header, arrays) {
      const { vertices, vertexNormals, faces } = this.surface;
      const low = [Infinity, Infinity, Infinity];
      const high = [-Infinity, -Infinity, -Infinity];
      for (const vertex of faces) {
        for (let axis = 0; axis < 3; axis += 1) {
          low[axis] = Math.min(low[axis], vertices[3 * vertex + axis]);
          high[axis] = Math.max(high[axis], vertices[3 * vertex + axis]);
        }
      }
      const size = Math.max(...[0, 1, 2].map((axis) => high[axis] - low[axis]));
      const scale = Math.sqrt(7) / (this.kernel.length * size);
      const facing = Math.sqrt(this.kernel.normal_weight);
      const dimensions = header.sound.detour_dimensions;
      const width = 6 + dimensions;
      const detour = header.sound.detour_step_m * scale * this.kernel.detour_weight;
      this.vertexFeatures = new Float64Array((vertices.length / 3) * width);
      for (let vertex = 0; vertex < vertices.length / 3; vertex += 1) {
        for (let axis = 0; axis < 3; axis += 1) {
          const middle = (low[axis] + high[axis]) / 2;
          this.vertexFeatures[vertex * width + axis] = vertexNormals[3 * vertex + axis] * facing;
          this.vertexFeatures[vertex * width + 3 + axis] = (vertices[3 * vertex + axis] - middle) * scale;
        }
        for (let axis = 0; axis < dimensions; axis += 1) {
          this.vertexFeatures[vertex * width + 6 + axis] = arrays.detours[vertex * dimensions + axis] * detour;
        }
      }
      this.width = width;
    }

    _at(face, barycentric) {
      const features = new Float64Array(this.width);
      for (let corner = 0; corner < 3; corner += 1) {
        const start = this.surface.faces[3 * face + corner] * this.width;
        for (let axis = 0; axis < this.width; axis += 1) {
          features[axis] += barycentric[corner] * this.vertexFeatures[start + axis];
        }
      }
      return features;
    }

    // Of features from `at` on in each array; `audio/surface_kernel.py` has the formula.
    _covariance(a, at, b, start) {
      let squared = 0;
      for (let axis = 3; axis < this.width; axis += 1) squared += (a[at + axis] - b[start + axis]) ** 2;
      let cosine = 1;
      for (let axis = 0; axis < 3; axis += 1) cosine += a[at + axis] * b[start + axis];
      const r = Math.sqrt(squared);
      return (((r / 15 + 0.4) * r + 1) * r + 1) * Math.exp(-r) * cosine;
    }

    // Shares of the stored places in the answer at a place: those whose covariance with it is largest.
    _shares(face, barycentric) {
      const here = this._at(face, barycentric);
      const near = Float64Array.from({ length: this.count }, (_, place) =>
        this._covariance(here, 0, this.places, place * this.width),
      );
      const order = Array.from(near.keys()).sort((a, b) => near[b] - near[a]).slice(0, NEIGHBOURS);
      const matrix = order.map((a) =>
        order.map((b) => this._covariance(this.places, a * this.width, this.places, b * this.width)),
      );
      order.forEach((_, index) => (matrix[index][index] += RIDGE));
      return { order, shares: solved(matrix, order.map((place) => near[place])) };
    }

    // Velocity along the normal, m/s, that an impulse (newton seconds) gives each mode where it is struck.
    amplitudes(face, barycentric, impulse, normal) {
      if (!this.frequencies.length) return [];
      const { order, shares } = this._shares(face, barycentric);
      const hats = [0, 1, 2]
        .map((corner) => [this.corrected.get(this.surface.faces[3 * face + corner]), barycentric[corner]])
        .filter(([row]) => row !== undefined);
      return this.steps.map((step, mode) => {
        let [struck, moved] = [0, 0];
        for (let axis = 0; axis < 3; axis += 1) {
          const start = (mode * 3 + axis) * this.count;
          let gain = 0;
          for (let index = 0; index < order.length; index += 1) gain += shares[index] * this.gains[start + order[index]];
          gain *= step;
          const first = (mode * 3 + axis) * this.corrected.size;
          for (const [row, share] of hats) gain += share * this.corrections[first + row] * this.correctionSteps[mode];
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

  // x of a symmetric positive matrix times x = right, by Cholesky's factors.
  function solved(matrix, right) {
    const n = right.length;
    const lower = matrix.map((values) => Float64Array.from(values));
    const x = Float64Array.from(right);
    for (let row = 0; row < n; row += 1) {
      for (let column = 0; column <= row; column += 1) {
        let sum = lower[row][column];
        for (let k = 0; k < column; k += 1) sum -= lower[row][k] * lower[column][k];
        lower[row][column] = row === column ? Math.sqrt(sum) : sum / lower[column][column];
      }
      for (let k = 0; k < row; k += 1) x[row] -= lower[row][k] * x[k];
      x[row] /= lower[row][row];
    }
    for (let row = n - 1; row >= 0; row -= 1) {
      for (let k = row + 1; k < n; k += 1) x[row] -= lower[k][row] * x[k];
      x[row] /= lower[row][row];
    }
    return x;
  }

  viewer.StoredModes = StoredModes;
})((window.objectfolderViewer ??= {}));
