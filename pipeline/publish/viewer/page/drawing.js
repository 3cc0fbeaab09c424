// The surface drawn by WebGL: colours of the surface in a studio, or under the one lamp of the data set, on white.
"use strict";
(function (viewer) {
  const { dot, plus, times } = viewer.algebra;

  const VERTEX = `#version 300 es
    in vec3 position; in vec3 normal; in vec3 colour;
    uniform mat4 projection;
    out vec3 place; out vec3 facing; out vec3 base;
    void main() { place = position; facing = normal; base = colour; gl_Position = projection * vec4(position, 1.0); }`;
  // Directions in the camera's axes (right, up, towards it), distance and powers of `objectfolder.vision.studio`,
  // whose sky is even here.
  const STUDIOS = {
    "studio": [[-0.6, 0.7, 0.8, 1.0], [0.9, 0.2, 0.6, 0.35], [0.2, 0.9, -0.7, 0.5]],
    "window": [[-1.0, 0.1, 0.1, 0.35], [-1.0, 0.1, 0.8, 0.35], [-1.0, 0.7, 0.1, 0.35], [-1.0, 0.7, 0.8, 0.35]]
  };
  const [MOST_LAMPS, NEARLY_WHITE, DISPLAY_GAMMA] = [4, 250, 2.2];
  const [RADIUS, SKY, LEVEL, SHARE] = [3, 0.2, 0.79, 0.95];
  // Radiance = scale * (power * cos / d^2 of each lamp + sky) * colour; no shadows.
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 place; in vec3 facing; in vec3 base;
    uniform vec4 lamps[${MOST_LAMPS}]; uniform vec3 eye; uniform float scale; uniform float sky;
    out vec4 pixel;
    void main() {
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

  // Each face as four, by the middles of its edges, which have colours of their own after the vertices'.
  function refined(surface, colours, { centre, scale }) {
    const { faces, vertices, cornerNormals } = surface;
    const decoded = Float32Array.from({ length: 256 }, (_, byte) => linear(byte / 255));
    const vertexCount = vertices.length / 3;
    const edges = new Map();
    const parts = { position: new Float32Array(12 * faces.length), normal: new Float32Array(12 * faces.length), colour: new Float32Array(12 * faces.length) };
    let written = 0;
    const write = ([position, normal, at]) => {
      for (let axis = 0; axis < 3; axis += 1) {
        parts.position[written] = (position[axis] - centre[axis]) / scale;
        parts.normal[written] = normal[axis];
        parts.colour[written] = decoded[colours[3 * at + axis]];
        written += 1;
      }
    };
    for (let face = 0; face < faces.length; face += 3) {
      const corners = [0, 1, 2].map((corner) => {
        const vertex = faces[face + corner];
        const normal = [0, 1, 2].map((axis) => cornerNormals[3 * (face + corner) + axis]);
        return [surface.vertex(vertex), normal, vertex];
      });
      const middles = [0, 1, 2].map((corner) => {
        const [a, b] = [corners[corner], corners[(corner + 1) % 3]];
        const key = Math.min(a[2], b[2]) * vertexCount + Math.max(a[2], b[2]);
        if (!edges.has(key)) edges.set(key, vertexCount + edges.size);
        return [times(plus(a[0], b[0]), 0.5), times(plus(a[1], b[1]), 0.5), edges.get(key)];
      });
      const [a, b, c] = corners;
      const [ab, bc, ca] = middles;
      for (const corner of [a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca]) write(corner);
    }
    return parts;
  }

  // Linear colour of which `SHARE` of the places are darker.
  function brightest(colours) {
    const levels = Array.from({ length: colours.length / 3 }, (_, place) => Math.max(...colours.subarray(3 * place, 3 * place + 3)));
    return linear((levels.sort((a, b) => a - b)[Math.floor(SHARE * (levels.length - 1))] ?? 255) / 255);
  }

  class Drawing {
    constructor(canvas, surface, colours, header) {
      const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, preserveDrawingBuffer: true });
      if (!gl) throw new Error("This browser has no WebGL 2, which draws the surface.");
      this.canvas = canvas;
      this.gl = gl;
      this.frame = header.frame;
      this.scale = header.radiance_scale;
      this.bright = Math.max(brightest(colours), 1e-3);
      [this.wanted, this.factors] = [header.brightness, {}];
      this.program = linked(gl);
      const attributes = refined(surface, colours, this.frame);
      this.count = attributes.position.length / 3;
      for (const [name, values] of Object.entries(attributes)) {
        const place = gl.getAttribLocation(this.program, name);
        gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
      }
      gl.enable(gl.DEPTH_TEST);
      gl.clearColor(1, 1, 1, 1);
    }

    draw(orbit) {
      const gl = this.gl;
      const side = Math.round(Math.min(1024, Math.max(128, this.canvas.clientWidth * (window.devicePixelRatio || 1))));
      if (this.canvas.width !== side) [this.canvas.width, this.canvas.height] = [side, side];
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
      if (!one && !this.factors[orbit.studio]) {
        this.factors[orbit.studio] = (this.wanted[orbit.studio] / this._level(side)) ** DISPLAY_GAMMA;
        return this.draw(orbit);
      }
      return side;
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
    const focal = 1 / Math.tan((viewer.FIELD_OF_VIEW_DEG * Math.PI) / 360);
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

  viewer.Drawing = Drawing;
})((window.objectfolderViewer ??= {}));
