// The surface drawn by WebGL: colours of the surface in a studio, or under the one lamp of the data set, on white.
import { dot, times } from "./algebra.js";
import { FIELD_OF_VIEW_DEG } from "./orbit.js";

const VERTEX = `#version 300 es
  in vec3 position; in vec3 normal; in vec2 steps; in vec3 grid;
  uniform mat4 projection;
  out vec3 place; out vec3 facing; out vec2 at; flat out ivec3 cells;
  void main() { place = position; facing = normal; at = steps; cells = ivec3(grid); gl_Position = projection * vec4(position, 1.0); }`;
// Directions in the camera's axes (right, up, towards it), distance and powers of `objectfolder.vision.studio`,
// whose sky is even here.
const STUDIOS = {
  "studio": [[-0.6, 0.7, 0.8, 1.0], [0.9, 0.2, 0.6, 0.35], [0.2, 0.9, -0.7, 0.5]],
  "window": [[-1.0, 0.1, 0.1, 0.35], [-1.0, 0.1, 0.8, 0.35], [-1.0, 0.7, 0.1, 0.35], [-1.0, 0.7, 0.8, 0.35]]
};
const [MOST_LAMPS, NEARLY_WHITE, DISPLAY_GAMMA] = [4, 250, 2.2];
const WIDTH = 2048; // of the texture of colours
const SAMPLES = 4; // of a pixel at rest; any WebGL 2 has so many
// While something moves, views that take longer are drawn half as fine, and those that take less twice: 60 a
// second have 16 ms each, some of them the page's own.
const [SLOW_MS, FAST_MS, COARSEST] = [12, 3, 0.25];
const [RADIUS, SKY, LEVEL, SHARE] = [3, 0.2, 0.79, 0.95];
// Radiance = scale * (power * cos / d^2 of each lamp + sky) * colour; no shadows.
const FRAGMENT = `#version 300 es
  precision highp float;
  in vec3 place; in vec3 facing; in vec2 at; flat in ivec3 cells;
  uniform sampler2D colours;
  uniform vec4 lamps[${MOST_LAMPS}]; uniform vec3 eye; uniform float scale; uniform float sky;
  out vec4 pixel;
  vec3 colour(int place) { return texelFetch(colours, ivec2(place % ${WIDTH}, place / ${WIDTH}), 0).rgb; }
  void main() {
    // Bilinear on the face's grid: its first place, and steps along two edges.
    ivec2 cell = clamp(ivec2(at), ivec2(0), cells.yz - 1);
    vec2 over = clamp(at - vec2(cell), 0.0, 1.0);
    int first = cells.x + cell.y * (cells.y + 1) + cell.x, below = first + cells.y + 1;
    vec3 base = mix(mix(colour(first), colour(first + 1), over.x), mix(colour(below), colour(below + 1), over.x), over.y);
    vec3 toEye = normalize(eye - place);
    vec3 n = normalize(facing);
    if (dot(n, toEye) < 0.0) n = -n;
    float light = sky * (1.0 + 0.5 * n.z);
    for (int i = 0; i < ${MOST_LAMPS}; i++) {
      vec3 toLamp = lamps[i].xyz - place;
      float squared = max(dot(toLamp, toLamp), 0.01);
      light += lamps[i].w * max(dot(n, toLamp), 0.0) * inversesqrt(squared) / squared;
    }
    vec3 linear = clamp(scale * base * light, 0.0, 1.0);
    vec3 low = 12.92 * linear, high = 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055;
    pixel = vec4(mix(high, low, lessThanEqual(linear, vec3(0.0031308))), 1.0);
  }`;

const linear = (value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);

// Corners of all faces, and of each face the grid of its colours.
function drawn(surface, grids, { centre, scale }) {
  const { faces, cornerNormals } = surface;
  const parts = {
    position: new Float32Array(3 * faces.length),
    normal: cornerNormals,
    steps: new Float32Array(2 * faces.length),
    grid: new Float32Array(3 * faces.length),
  };
  let start = 0;
  for (let face = 0; face < faces.length; face += 3) {
    const [first, columns, rows] = grids.subarray(face, face + 3);
    for (let corner = 0; corner < 3; corner += 1) {
      const position = surface.vertex(faces[face + corner]).map((value, axis) => (value - centre[axis]) / scale);
      parts.position.set(position, 3 * (face + corner));
      parts.grid.set([start, columns, rows], 3 * (face + corner));
    }
    parts.steps[2 * (face + ((first + 1) % 3))] = columns;
    parts.steps[2 * (face + ((first + 2) % 3)) + 1] = rows;
    start += (columns + 1) * (rows + 1);
  }
  return parts;
}

function texture(gl, colours) {
  const height = Math.ceil(colours.length / 3 / WIDTH);
  const texels = new Uint8Array(3 * WIDTH * height);
  texels.set(colours);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8, WIDTH, height, 0, gl.RGB, gl.UNSIGNED_BYTE, texels);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
}

// Linear colour of which `SHARE` of the places are darker.
function brightest(colours) {
  const levels = Array.from({ length: colours.length / 3 }, (_, place) => Math.max(...colours.subarray(3 * place, 3 * place + 3)));
  return linear((levels.sort((a, b) => a - b)[Math.floor(SHARE * (levels.length - 1))] ?? 255) / 255);
}

export class Drawing {
  constructor(canvas, surface, { colours, grids }, header) {
    const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This browser has no WebGL 2, which draws the surface.");
    this.canvas = canvas;
    this.gl = gl;
    this.share = 1; // of the side of a view at rest
    this.frame = header.frame;
    this.scale = header.radiance_scale;
    this.bright = Math.max(brightest(colours), 1e-3);
    [this.wanted, this.factors] = [header.brightness, {}];
    this.program = linked(gl);
    const attributes = drawn(surface, grids, this.frame);
    this.count = surface.faces.length;
    texture(gl, colours);
    for (const [name, values] of Object.entries(attributes)) {
      const place = gl.getAttribLocation(this.program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, name === "steps" ? 2 : 3, gl.FLOAT, false, 0, 0);
    }
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(1, 1, 1, 1);
  }

  draw(orbit, moving = false) {
    const gl = this.gl;
    const start = performance.now();
    const whole = Math.min(1024, Math.max(128, this.canvas.clientWidth * (window.devicePixelRatio || 1)));
    const side = Math.round(whole * (moving ? this.share : 1));
    if (this.canvas.width !== side) [this.canvas.width, this.canvas.height] = [side, side];
    if (!moving) this._smooth(side);
    gl.viewport(0, 0, side, side);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    const { right, up, backward, position } = orbit.axes();
    const { centre, scale } = this.frame;
    const one = orbit.lightPosition()?.map((value, axis) => (value - centre[axis]) / scale);
    const lamps = one ? [...one, 1] : STUDIOS[orbit.studio].flatMap(([x, y, z, power]) => {
      const away = [0, 1, 2].map((axis) => x * right[axis] + y * up[axis] + z * backward[axis]);
      return [...times(away, RADIUS / Math.hypot(...away)), power * RADIUS ** 2];
    });
    const at = (name) => gl.getUniformLocation(this.program, name);
    gl.uniformMatrix4fv(at("projection"), false, projection(right, up, backward, position));
    gl.uniform4fv(at("lamps"), [...lamps, ...Array(4 * MOST_LAMPS - lamps.length).fill(0)]);
    gl.uniform1f(at("sky"), one ? 0.1 : SKY);
    gl.uniform3fv(at("eye"), position);
    gl.uniform1f(at("scale"), one ? this.scale : (LEVEL / this.bright) * (this.factors[orbit.studio] ?? 1));
    gl.drawArrays(gl.TRIANGLES, 0, this.count);
    if (!moving) this._resolve(side);
    if (!one && !this.factors[orbit.studio]) {
      this.factors[orbit.studio] = (this.wanted[orbit.studio] / this._level(side)) ** DISPLAY_GAMMA;
      return this.draw(orbit, moving);
    }
    if (moving) {
      // A read waits for the drawing, so that views do not queue behind the finger.
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      this.keepUp(performance.now() - start);
    }
    return side;
  }

  // Draws next with edges that are smooth, which costs as much again and waits until nothing moves.
  _smooth(side) {
    const gl = this.gl;
    this.smooth ??= { frame: gl.createFramebuffer(), colour: gl.createRenderbuffer(), depth: gl.createRenderbuffer() };
    const { frame, colour, depth } = this.smooth;
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    for (const [buffer, format, at] of [[colour, gl.RGBA8, gl.COLOR_ATTACHMENT0], [depth, gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT]]) {
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      if (this.smooth.side !== side) gl.renderbufferStorageMultisample(gl.RENDERBUFFER, SAMPLES, format, side, side);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, at, gl.RENDERBUFFER, buffer);
    }
    this.smooth.side = side;
  }

  // Shows what was drawn since `_smooth`.
  _resolve(side) {
    const gl = this.gl;
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, side, side, 0, 0, side, side, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  // Chooses how fine the next view is that moves, by the milliseconds that one took.
  keepUp(took) {
    if (took > SLOW_MS) this.share = Math.max(COARSEST, this.share / 2);
    else if (took < FAST_MS) this.share = Math.min(1, 2 * this.share);
  }

  // The mean level, 0 to 1 as displayed, of what is drawn and not white.
  _level(side) {
    const pixels = new Uint8Array(4 * side * side);
    this.gl.readPixels(0, 0, side, side, this.gl.RGBA, this.gl.UNSIGNED_BYTE, pixels);
    let [sum, count] = [0, 0];
    for (let at = 0; at < pixels.length; at += 4) {
      const [red, green, blue] = pixels.subarray(at, at + 3);
      if (Math.min(red, green, blue) >= NEARLY_WHITE) continue;
      sum += red + green + blue;
      count += 3;
    }
    return sum ? sum / count / 255 : 1;
  }
}

// Column by column: world to clip space, near and far round the unit frame.
function projection(right, up, backward, position) {
  const focal = 1 / Math.tan((FIELD_OF_VIEW_DEG * Math.PI) / 360);
  const [near, far] = [0.05, 8];
  const [a, b] = [(near + far) / (near - far), (2 * near * far) / (near - far)];
  const columns = [0, 1, 2].map((axis) => [
    focal * right[axis], focal * up[axis], a * backward[axis], -backward[axis],
  ]);
  const along = [right, up, backward].map((direction) => -dot(direction, position));
  return new Float32Array([...columns.flat(), focal * along[0], focal * along[1], a * along[2] + b, -along[2]]);
}

function linked(gl) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error("The shaders do not compile here.");
  return program;
}
