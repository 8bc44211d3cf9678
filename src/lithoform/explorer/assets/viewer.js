// One stone in WebGL: drag or arrow keys turn it, the wheel or + and - bring it nearer, 0 sets it back.
"use strict";
window.lithoform = window.lithoform || {};

(() => {
  const VERTEX = `#version 300 es
    uniform mat3 turn; uniform vec2 zoom; uniform float size;
    in vec3 place; in vec3 normal; in float pit;
    out vec3 seen; out vec3 across; out float deep;
    void main() {
      vec3 p = turn * place / size;
      seen = p; across = turn * normal; deep = pit;
      gl_Position = vec4(p.xy * zoom, -0.5 * p.z, 1.0);
    }`;
  // Lights seen from the eye, as in lithoform's pictures: a warm key from far to the side, a cool fill, one from below.
  const FRAGMENT = `#version 300 es
    precision highp float;
    uniform vec3 stone;
    in vec3 seen; in vec3 across; in float deep;
    out vec4 colour;
    void main() {
      vec3 face = normalize(cross(dFdx(seen), dFdy(seen)));
      if (face.z < 0.0) face = -face;
      vec3 n = normalize(normalize(across) + 0.7 * face);
      vec3 light = max(dot(n, normalize(vec3(-1.6, 1.4, 0.35))), 0.0) * vec3(1.0, 0.965, 0.91)
                 + max(dot(n, normalize(vec3(1.2, 0.4, 0.9))), 0.0) * 0.34 * vec3(0.875, 0.91, 1.0)
                 + max(dot(n, normalize(vec3(0.0, -1.2, 0.5))), 0.0) * 0.22
                 + 0.16;
      colour = vec4(stone * light * (1.0 - 0.8 * clamp(deep, -0.35, 0.6)), 1.0);
    }`;
  const HOME = { turn: Math.atan2(-1.0, 0.75), lift: Math.atan2(0.65, 1.25), zoom: 1.0 };

  function program(gl) {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    return made;
  }

  // Normals of the vertices by the areas of their faces, and how deep each lies below its neighbours' mean.
  function shade(vertices, faces) {
    const normals = new Float32Array(vertices.length), means = new Float32Array(vertices.length);
    const counts = new Float32Array(vertices.length / 3);
    for (let i = 0; i < faces.length; i += 3) {
      const a = 3 * faces[i], b = 3 * faces[i + 1], c = 3 * faces[i + 2];
      const ux = vertices[b] - vertices[a], vx = vertices[c] - vertices[a];
      const uy = vertices[b + 1] - vertices[a + 1], vy = vertices[c + 1] - vertices[a + 1];
      const uz = vertices[b + 2] - vertices[a + 2], vz = vertices[c + 2] - vertices[a + 2];
      const n = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
      for (const [at, next] of [[a, b], [b, c], [c, a]]) {
        for (let k = 0; k < 3; k++) { normals[at + k] += n[k]; means[at + k] += vertices[next + k]; }
        counts[at / 3] += 1;
      }
    }
    const pits = new Float32Array(counts.length);
    for (let i = 0; i < counts.length; i++) {
      const at = 3 * i, long = Math.hypot(normals[at], normals[at + 1], normals[at + 2]) || 1, n = counts[i] || 1;
      let along = 0;
      for (let k = 0; k < 3; k++) {
        normals[at + k] /= long;
        const away = means[at + k] / n - vertices[at + k];
        along += away * normals[at + k];
      }
      // The faces' area is about the square of the edges: a step over the length of an edge is a plain number.
      pits[i] = along / (Math.sqrt(long / n) || 1) * 2.0;
    }
    return { normals, pits };
  }

  class StoneView {
    constructor(canvas) {
      this.canvas = canvas;
      this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true });
      this.pose = { ...HOME };
      this.count = 0;
      if (!this.gl) return;
      const gl = this.gl;
      this.program = program(gl);
      this.at = {};
      for (const name of ["turn", "zoom", "size", "stone"]) this.at[name] = gl.getUniformLocation(this.program, name);
      this.buffers = {};
      for (const [name, width] of [["place", 3], ["normal", 3], ["pit", 1]]) {
        const buffer = this.buffers[name] = gl.createBuffer(), where = gl.getAttribLocation(this.program, name);
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.enableVertexAttribArray(where);
        gl.vertexAttribPointer(where, width, gl.FLOAT, false, 0, 0);
      }
      this.buffers.faces = gl.createBuffer();
      gl.useProgram(this.program);
      gl.enable(gl.DEPTH_TEST);
    }

    show(stone) {
      const gl = this.gl;
      if (!gl) return;
      const { normals, pits } = shade(stone.vertices, stone.faces);
      for (const [name, values] of [["place", stone.vertices], ["normal", normals], ["pit", pits]]) {
        gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
      }
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.faces);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, stone.faces, gl.DYNAMIC_DRAW);
      let far = 0;
      for (let i = 0; i < stone.vertices.length; i += 3) {
        far = Math.max(far, Math.hypot(stone.vertices[i], stone.vertices[i + 1], stone.vertices[i + 2]));
      }
      this.size = far || 1;
      this.count = stone.faces.length;
      this.draw();
    }

    draw() {
      const gl = this.gl, canvas = this.canvas;
      if (!gl || !this.count || !canvas.width || !canvas.height) return;
      const { turn, lift, zoom } = this.pose, [s, c] = [Math.sin(turn), Math.cos(turn)];
      const [sl, cl] = [Math.sin(lift), Math.cos(lift)];
      // Rows: to the right, upwards and towards the eye; WebGL takes columns.
      const rows = [[-s, c, 0], [-c * sl, -s * sl, cl], [c * cl, s * cl, sl]];
      const matrix = [0, 1, 2].flatMap((k) => rows.map((row) => row[k]));
      const least = 0.94 * Math.min(canvas.width, canvas.height) * zoom;
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniformMatrix3fv(this.at.turn, false, matrix);
      gl.uniform2f(this.at.zoom, least / canvas.width, least / canvas.height);
      gl.uniform1f(this.at.size, this.size);
      gl.uniform3f(this.at.stone, 0.79, 0.75, 0.69);
      gl.drawElements(gl.TRIANGLES, this.count, gl.UNSIGNED_INT, 0);
    }

    move(turn, lift, zoom) {
      const pose = this.pose;
      pose.turn += turn;
      pose.lift = Math.max(-1.55, Math.min(1.55, pose.lift + lift));
      pose.zoom = Math.max(0.3, Math.min(20, pose.zoom * zoom));
      this.draw();
    }
  }

  // A canvas that fills an element, with the pointer and the keyboard.
  lithoform.view = (element, label) => {
    const canvas = document.createElement("canvas");
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    const help = "arrow keys turn it, + and - bring it nearer or farther, 0 sets it back";
    canvas.setAttribute("aria-label", `${label}; ${help}`);
    canvas.title = "Drag to turn, wheel to come nearer; or: " + help;
    element.replaceChildren(canvas);
    const view = new StoneView(canvas);
    if (!view.gl) {
      element.textContent = "This browser draws no WebGL 2, which stones need; switch it on or take another browser.";
      return view;
    }
    new ResizeObserver(() => {
      const ratio = Math.min(window.devicePixelRatio || 1, 2);
      canvas.width = Math.round(element.clientWidth * ratio);
      canvas.height = Math.round(element.clientHeight * ratio);
      view.draw();
    }).observe(element);
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) view.move(-0.01 * event.movementX, 0.01 * event.movementY, 1);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      view.move(0, 0, Math.exp(-0.0015 * event.deltaY));
    }, { passive: false });
    const steps = { ArrowLeft: [0.1, 0, 1], ArrowRight: [-0.1, 0, 1], ArrowUp: [0, 0.1, 1], ArrowDown: [0, -0.1, 1],
      "+": [0, 0, 1.1], "=": [0, 0, 1.1], "-": [0, 0, 1 / 1.1] };
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;  // the browser's own
      if (event.key === "0") view.pose = { ...HOME };
      else if (!steps[event.key]) return;
      event.preventDefault();
      view.move(...(steps[event.key] || [0, 0, 1]));
    });
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      lithoform.say("The browser took the drawing surface away; reload the page.");
    });
    return view;
  };

  // Small pictures, all drawn on one surface: a browser has few of them.
  let hidden = null;
  lithoform.thumbnail = (stone, canvas) => {
    if (!hidden) {
      const surface = document.createElement("canvas");
      [surface.width, surface.height] = [canvas.width, canvas.height];
      hidden = new StoneView(surface);
    }
    if (!hidden.gl) return;
    hidden.show(stone);
    canvas.getContext("2d").drawImage(hidden.canvas, 0, 0);
  };
})();
