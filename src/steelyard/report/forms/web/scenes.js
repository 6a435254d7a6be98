// 3-D views: turned by buttons and keys, replayed along courses. `figures.js` draws them.
"use strict";

const VIEWS = { left: [-15, 0, 1], right: [15, 0, 1], up: [0, 10, 1], down: [0, -10, 1], closer: [0, 0, 0.8], farther: [0, 0, 1.25] };
const KEYS = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down", "+": "closer", "=": "closer", "-": "farther", 0: "reset" };
const FIRST_VIEW = { eye: { x: 1.3, y: -1.3, z: 0.75 }, center: { x: 0, y: 0, z: -0.2 }, up: { x: 0, y: 0, z: 1 } };

// Numbers as the page has them: a list, or {dtype, bdata, shape} with little-endian bytes.
function numbers(packed) {
  if (Array.isArray(packed)) return packed;
  const bytes = Uint8Array.from(atob(packed.bdata), (character) => character.charCodeAt(0));
  return packed.dtype === "f8" ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
}

// Pose of a course at an instant: straight between its instants, the turn by the shorter way.
function poseAt(course, instant) {
  const { time, position, rotation } = course;
  let low = 0, high = time.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (time[middle] <= instant) low = middle; else high = middle;
  }
  const span = time[high] - time[low];
  const part = span > 0 ? Math.min(Math.max((instant - time[low]) / span, 0), 1) : 0;
  const between = (values, width, sign) =>
    Array.from({ length: width }, (_, k) => (1 - part) * values[width * low + k] + part * sign * values[width * high + k]);
  let along = 0;
  for (let k = 0; k < 4; k++) along += rotation[4 * low + k] * rotation[4 * high + k];
  const turned = between(rotation, 4, along < 0 ? -1 : 1);
  const norm = Math.hypot(...turned) || 1;
  const [w, x, y, z] = turned.map((value) => value / norm);
  return {
    p: between(position, 3, 1),
    R: [
      [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
      [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
      [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ],
  };
}

// Points of a trace in the world; those that move are given in the platform frame.
function inWorld(trace, pose) {
  const out = [Float64Array.from(trace.x), Float64Array.from(trace.y), Float64Array.from(trace.z)];
  trace.moves.forEach((moves, i) => {
    if (!moves || trace.x[i] === null) return;
    for (let k = 0; k < 3; k++) {
      out[k][i] = pose.p[k] + pose.R[k][0] * trace.x[i] + pose.R[k][1] * trace.y[i] + pose.R[k][2] * trace.z[i];
    }
  });
  for (let i = 0; i < trace.x.length; i++) if (trace.x[i] === null) out[0][i] = out[1][i] = out[2][i] = NaN;
  return out;
}

class Scene {
  constructor(plot, figure) {
    this.plot = plot;
    this.controls = plot.parentElement.querySelector(".controls");
    this.courses = (figure.courses || []).map((course) => ({
      time: numbers(course.time), position: numbers(course.position), rotation: numbers(course.rotation),
    }));
    this.moving = [];
    if (this.courses.length) {
      figure.data.forEach((trace, index) => {
        if (trace.meta && trace.meta.moves) {
          this.moving.push({ index, moves: trace.meta.moves, x: numbers(trace.x), y: numbers(trace.y), z: numbers(trace.z) });
        }
      });
      this.course = this.courses[0];
      this.instant = this.course.time[0];
    }
    this.ranges = this.moving.length ? this.reach(figure.data) : null;
    this.first = { ...FIRST_VIEW, ...((figure.layout.scene || {}).camera || {}) };
  }

  // The first view; a narrow window cuts its sides off, so that it is from farther away.
  get home() {
    const away = Math.max(1, (1.3 * this.plot.clientHeight) / this.plot.clientWidth);
    const eye = Object.fromEntries(Object.entries(this.first.eye).map(([axis, value]) => [axis, away * value]));
    return structuredClone({ ...this.first, eye });
  }

  // Ranges of the axes that hold whatever moves, so that they stand still.
  reach(data) {
    const ends = [0, 1, 2].map(() => [Infinity, -Infinity]);
    const widen = (points) => points.forEach((values, k) => {
      for (const value of values) {
        if (value === null || Number.isNaN(value)) continue;
        ends[k][0] = Math.min(ends[k][0], value);
        ends[k][1] = Math.max(ends[k][1], value);
      }
    });
    const still = new Set(data.keys());
    this.moving.forEach((trace) => still.delete(trace.index));
    still.forEach((index) => {
      const { x, y, z } = data[index];
      if (x && y && z) widen([x, y, z].map((each) => Array.from(numbers(each)).flat()));
    });
    for (const course of this.courses) {
      const step = Math.max(1, Math.floor(course.time.length / 200));
      for (let i = 0; i < course.time.length; i += step) {
        const pose = poseAt(course, course.time[i]);
        this.moving.forEach((trace) => widen(inWorld(trace, pose)));
      }
    }
    return ends.map(([low, high]) => {
      const margin = 0.04 * (high - low) || 0.1;
      return [low - margin, high + margin];
    });
  }

  // Traces and layout as they are at the instant shown.
  place(data, layout) {
    const scene = { ...layout.scene, camera: this.home };
    if (this.ranges) {
      ["xaxis", "yaxis", "zaxis"].forEach((axis, k) => { scene[axis] = { range: this.ranges[k], ...scene[axis] }; });
      const pose = poseAt(this.course, this.instant);
      this.moving.forEach((trace) => {
        const [x, y, z] = inWorld(trace, pose);
        data[trace.index] = { ...data[trace.index], x, y, z };
      });
    }
    return [data, { ...layout, scene }];
  }

  view(way) {
    const now = this.plot._fullLayout.scene.camera;
    if (way === "reset") return Plotly.relayout(this.plot, { "scene.camera": this.home });
    const [azimuth, elevation, zoom] = VIEWS[way];
    const [x, y, z] = ["x", "y", "z"].map((axis) => now.eye[axis] - now.center[axis]);
    const distance = Math.min(Math.max(Math.hypot(x, y, z) * zoom, 0.15), 8);
    const around = Math.atan2(y, x) + (azimuth * Math.PI) / 180;
    const limit = (85 * Math.PI) / 180;
    const above = Math.min(Math.max(Math.atan2(z, Math.hypot(x, y)) + (elevation * Math.PI) / 180, -limit), limit);
    const eye = {
      x: now.center.x + distance * Math.cos(above) * Math.cos(around),
      y: now.center.y + distance * Math.cos(above) * Math.sin(around),
      z: now.center.z + distance * Math.sin(above),
    };
    return Plotly.relayout(this.plot, { "scene.camera": { ...structuredClone(now), eye, up: { x: 0, y: 0, z: 1 } } });
  }

  // Draws the instant. Only the points change; `Plotly.restyle` would work out everything anew, at a few pictures a second.
  show() {
    this.tell();
    if (!this.moving.length) return;
    const pose = poseAt(this.course, this.instant);
    const drawing = this.plot._fullLayout.scene._scene;
    this.moving.forEach((trace) => {
      const full = this.plot._fullData[trace.index];
      [full.x, full.y, full.z] = inWorld(trace, pose);
      drawing.traces[full.uid].update(full);
    });
    this.flush();
  }

  // Draws at once what would be drawn with the next picture of the screen.
  flush() {
    this.plot._fullLayout.scene._scene.glplot.redraw();
  }

  // A copy for paper: what WebGL draws reaches it with the next picture of the screen only, and that comes after the print.
  copy() {
    dispatchEvent(new Event("resize")); // to the size of the paper
    this.flush();
    const from = this.plot.querySelector(".gl-container canvas");
    const box = from.getBoundingClientRect(), origin = this.plot.getBoundingClientRect();
    const to = Object.assign(document.createElement("canvas"), { className: "copy", width: from.width, height: from.height });
    to.setAttribute("aria-hidden", "true");
    to.style.cssText = `left: ${box.left - origin.left}px; top: ${box.top - origin.top}px; width: ${box.width}px; height: ${box.height}px`;
    to.getContext("2d").drawImage(from, 0, 0);
    this.plot.querySelectorAll(".copy").forEach((old) => old.remove());
    this.plot.append(to);
  }

  tell() {
    const text = `${this.instant.toFixed(2)} s`;
    this.slider.value = this.instant;
    this.slider.setAttribute("aria-valuetext", text);
    this.now.textContent = text;
  }

  play(on) {
    const end = this.course.time[this.course.time.length - 1];
    this.playing = on;
    this.button.textContent = on ? "pause" : "play";
    if (!on) return;
    if (this.instant >= end) this.instant = this.course.time[0];
    let last = performance.now();
    const step = (now) => {
      if (!this.playing) return;
      this.instant = Math.min(this.instant + Math.max(now - last, 0) / 1000, end);
      last = now;
      if (this.instant >= end) this.play(false); else requestAnimationFrame(step);
      this.show();
    };
    requestAnimationFrame(step);
  }

  choose(index) {
    if (this.playing) this.play(false);
    this.course = this.courses[index];
    this.instant = this.course.time[0];
    this.slider.min = this.instant;
    this.slider.max = this.course.time[this.course.time.length - 1];
  }

  // Makes the controls work; once, after the first drawing.
  connect() {
    const find = (name) => this.controls.querySelector(`[data-motion="${name}"]`);
    this.controls.hidden = false;
    this.controls.querySelectorAll("[data-view]").forEach((button) => button.addEventListener("click", () => this.view(button.dataset.view)));
    this.plot.addEventListener("keydown", (event) => {
      const way = KEYS[event.key];
      if (!way || event.target !== this.plot || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      this.view(way);
    });
    if (!this.courses.length) return;
    this.slider = find("time");
    this.button = find("play");
    this.now = find("now");
    this.button.addEventListener("click", () => this.play(!this.playing));
    this.slider.addEventListener("input", () => { if (this.playing) this.play(false); this.instant = Number(this.slider.value); this.show(); });
    const select = find("course");
    if (select) select.addEventListener("change", () => { this.choose(Number(select.value)); this.show(); });
    this.choose(0);
    this.tell();
  }
}
