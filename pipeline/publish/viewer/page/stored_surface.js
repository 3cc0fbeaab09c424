// The surface: vertices as the package decodes them, its shading normals, and the first place that a ray meets.
import { dot, plus, minus, times, cross, length, unit } from "./algebra.js";

const NORMAL_STEPS = 127;

export class StoredSurface {
  constructor(header, arrays) {
    const { origin, step } = header.surface;
    this.faces = arrays.faces;
    this.vertices = Float64Array.from(arrays.positions, (value, index) => origin[index % 3] + value * step);
    this.faceCount = this.faces.length / 3;
    const corners = this.faces.length;
    this.cornerNormals = Float32Array.from({ length: 3 * corners }, (_, at) => {
      return arrays.normals[(at % 3) * corners + Math.floor(at / 3)] / NORMAL_STEPS;
    });
    this._bins();
  }

  vertex(index) {
    return [this.vertices[3 * index], this.vertices[3 * index + 1], this.vertices[3 * index + 2]];
  }

  // Of the farthest vertex from the centre of a unit frame, in its unit.
  reach({ centre, scale }) {
    let farthest = 0;
    for (const index of this.faces) farthest = Math.max(farthest, length(minus(this.vertex(index), centre)));
    return farthest / scale;
  }

  corners(face) {
    return [0, 1, 2].map((corner) => this.vertex(this.faces[3 * face + corner]));
  }

  // Spheres round runs of faces: the surface is stored in walking order, so that runs are compact.
  _bins() {
    const size = 24;
    this.bins = [];
    for (let start = 0; start < this.faceCount; start += size) {
      const stop = Math.min(start + size, this.faceCount);
      const low = [Infinity, Infinity, Infinity];
      const high = [-Infinity, -Infinity, -Infinity];
      for (let index = 3 * start; index < 3 * stop; index += 1) {
        for (let axis = 0; axis < 3; axis += 1) {
          const value = this.vertices[3 * this.faces[index] + axis];
          low[axis] = Math.min(low[axis], value);
          high[axis] = Math.max(high[axis], value);
        }
      }
      const centre = times(plus(low, high), 0.5);
      this.bins.push({ start, stop, centre, radius: (length(minus(high, low)) / 2) * 1.000001 });
    }
  }

  // First hit, on either side of a face: {point, normal}, or null. Moeller and Trumbore 1997.
  firstHit(origin, direction) {
    let best = null;
    let nearest = Infinity;
    for (const { start, stop, centre, radius } of this.bins) {
      const away = minus(centre, origin);
      const along = dot(away, direction);
      if (dot(away, away) - along * along > radius * radius) continue;
      for (let face = start; face < stop; face += 1) {
        const [a, b, c] = this.corners(face);
        const [ab, ac] = [minus(b, a), minus(c, a)];
        const p = cross(direction, ac);
        const determinant = dot(ab, p);
        if (determinant === 0) continue;
        const t = minus(origin, a);
        const u = dot(t, p) / determinant;
        const q = cross(t, ab);
        const v = dot(direction, q) / determinant;
        const distance = dot(ac, q) / determinant;
        if (u < 0 || v < 0 || u + v > 1 || distance <= 0 || distance >= nearest) continue;
        nearest = distance;
        best = { face, barycentric: [1 - u - v, u, v] };
      }
    }
    return best && this.placeOn(best.face, best.barycentric);
  }

  // {point, normal} of a place on a face.
  placeOn(face, barycentric) {
    const interpolated = (values, indices) =>
      [0, 1, 2].map((axis) => indices.reduce((sum, at, corner) => sum + barycentric[corner] * values[3 * at + axis], 0));
    const three = [0, 1, 2].map((corner) => 3 * face + corner);
    const point = interpolated(this.vertices, three.map((corner) => this.faces[corner]));
    return { point, normal: unit(interpolated(this.cornerNormals, three)) };
  }
}
