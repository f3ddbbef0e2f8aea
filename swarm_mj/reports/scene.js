// The 3-D picture of one run: fills plotly's traces from packed arrays and moves what moves with time.
"use strict";

const FIELD_OF_VIEW = 0.414; // tangent of half of plotly's vertical field of view
/** After so many pictures without a change the camera rests. */
const CALM_FRAMES = 20;

class SceneView {
  constructor(run, div, labels, modes) {
    this.run = run;
    this.div = div;
    this.names = new Names(this, labels);
    this.modes = modes;
    const packed = run.scene;
    this.n = packed.r.shape[1];
    this.count = packed.r.shape[0];
    this.body = new Mesh(unpack(packed.body_vertices), unpack(packed.body_faces));
    this.target = new Mesh(unpack(packed.target_vertices), unpack(packed.target_faces));
    for (const name of ["r", "z", "C", "length", "sun", "earth", "rays", "ray_length", "first_seen", "first_seen_passage"]) {
      if (packed[name]) this[name] = unpack(packed[name]);
    }
    this.mode = unpack(run.mode);
    this.times = unpack(run.times);
    this.passage = false;
    this.views = true;
    this.directions = false;
    this.held = false;
    this.still = CALM_FRAMES;
    this.queue = Promise.resolve();
    this._frameBox();
  }

  /** A cube around everything, so that the axes never move. */
  _frameBox() {
    const low = [Infinity, Infinity, Infinity];
    const high = low.map((v) => -v);
    const grow = (rows) => {
      for (let place = 0; place < rows.length; place += 1) {
        const axis = place % 3;
        if (rows[place] < low[axis]) low[axis] = rows[place];
        if (rows[place] > high[axis]) high[axis] = rows[place];
      }
    };
    grow(this.body.vertices);
    grow(this.target.vertices);
    this.bodyRadius = Math.max(...high.map((v, k) => Math.max(v, -low[k])));
    grow(this.r);
    for (let k = 0; k < this.count; k += 1) for (let j = 0; j < this.n; j += 1) grow(this.tip(k, j));
    this.centre = low.map((v, k) => (v + high[k]) / 2);
    this.half = 1.05 * Math.max(...high.map((v, k) => (v - low[k]) / 2), 1.75 * this.bodyRadius);
  }

  position(k, j) {
    const place = 3 * (k * this.n + j);
    return [this.r[place], this.r[place + 1], this.r[place + 2]];
  }

  /** Where the line along +z of spacecraft j ends. */
  tip(k, j) {
    const place = k * this.n + j;
    return this.position(k, j).map((v, axis) => v + this.length[place] * this.z[3 * place + axis]);
  }

  observing(k, j) {
    return this.modes[this.mode[k * this.n + j]].observing;
  }

  /** Border of the picture that spacecraft j takes, in A, pulled off the ground a little. */
  border(k, j) {
    const rays = this.rays.length / 3;
    const watching = this.ray_length.length / (this.count * rays);
    const turn = 9 * (k * watching + j);
    const from = this.position(k, j);
    return Array.from({ length: rays }, (_, ray) => {
      const length = 0.994 * this.ray_length[(k * watching + j) * rays + ray];
      if (Number.isNaN(length)) return [null, null, null];
      return from.map((v, axis) => {
        let along = 0;
        for (let b = 0; b < 3; b += 1) along += this.C[turn + 3 * b + axis] * this.rays[3 * ray + b];
        return v + length * along;
      });
    });
  }

  /** What changes with time, by part of the picture. */
  frame(k) {
    const sun = [...this.sun.subarray(3 * k, 3 * k + 3)];
    const spots = Array.from({ length: this.n }, (_, j) => this.position(k, j));
    const colours = spots.map((_, j) => this.modes[this.mode[k * this.n + j]].colour);
    const sight = spots.flatMap((spot, j) => [spot, this.tip(k, j), [null, null, null]]);
    const signs = this.signs(k).flatMap(({ from, to }) => [from, to, [null, null, null]]);
    return {
      body: { intensity: Mesh.light(this.body.vertexNormals, sun) },
      target: { intensity: this.cells(k, sun) },
      sight: { ...xyz(sight), "line.color": colours.flatMap((c) => [c, c, c]) },
      views: xyz(this.pictures(k)),
      spacecraft: {
        ...xyz(spots),
        "marker.color": colours,
        hovertext: spots.map((_, j) => this.describe(k, j)),
      },
      directions: xyz(signs),
    };
  }

  /** Lines off the body towards Sun and Earth, and what they are called. */
  signs(k) {
    if (!this.directions) return [];
    return [
      ["Sun", this.sun, 1.7],
      ["Earth", this.earth, 1.5],
    ].map(([word, directions, reach]) => {
      const at = (share) => Array.from(directions.subarray(3 * k, 3 * k + 3), (v) => share * this.bodyRadius * v);
      return { word, from: at(1.1), to: at(reach) };
    });
  }

  /** Pixels right and down from the picture's middle; none of points beside or behind the camera. */
  flat(points) {
    const numbers = ({ x, y, z }) => [x, y, z];
    const [eye, to, upward] = [this.view.eye, this.view.center, this.view.up].map(numbers);
    const forward = unit(to.map((v, k) => v - eye[k]));
    const right = unit(cross(forward, upward));
    const up = cross(right, forward);
    const scale = this.div.clientHeight / 2 / FIELD_OF_VIEW;
    return points.map((point) => {
      const arm = point.map((v, k) => (v - this.centre[k]) / (2 * this.half) - eye[k]);
      const ahead = dot(arm, forward);
      return ahead > 0 ? [(scale * dot(arm, right)) / ahead, (-scale * dot(arm, up)) / ahead] : null;
    });
  }

  /** As `flat`, but none of points behind the body. */
  seen(points) {
    const eye = [this.view.eye.x, this.view.eye.y, this.view.eye.z].map((v, k) => this.centre[k] + 2 * this.half * v);
    const covered = (point) => [this.body, this.target].some((mesh) => mesh.stands(eye, point));
    return this.flat(points).map((place, j) => (place && covered(points[j]) ? null : place));
  }

  cells(k, sun) {
    const light = Mesh.light(this.target.faceNormals, sun);
    const seen = this.passage ? this.first_seen_passage : this.first_seen;
    const now = this.times[k];
    return light.map((value, cell) => (seen[cell] <= now + 1e-6 ? 0.52 : 0) + 0.48 * value);
  }

  pictures(k) {
    const points = [];
    if (!this.views || !this.rays) return points;
    const watching = (this.ray_length.length / this.count / this.rays.length) * 3;
    for (let j = 0; j < watching; j += 1) {
      if (!this.observing(k, j)) continue;
      const border = this.border(k, j);
      points.push(...border, border[0], [null, null, null]);
    }
    return points;
  }

  describe(k, j) {
    const place = k * this.n + j;
    const range = Math.hypot(...this.position(k, j));
    return `${this.run.names[j]}: ${this.modes[this.mode[place]].meaning}<br>${range.toFixed(2)} km from the centre`;
  }

  /** Start the picture: static parts, the first instant and the camera. */
  async start(figure, k) {
    this.parts = figure.data.map((trace) => trace.meta);
    const trace = (part) => figure.data[this.parts.indexOf(part)];
    this.view = this.overview();
    this.shown = k;
    this.body.fill(trace("body"));
    this.target.fill(trace("target"));
    Object.assign(trace("paths"), xyz(this.paths()));
    Object.assign(trace("mothership"), xyz([this.position(0, 0)]));
    for (const [part, changes] of Object.entries(this.frame(k))) {
      for (const [key, value] of Object.entries(changes)) {
        const [outer, inner] = key.split(".");
        if (inner) trace(part)[outer] = { ...trace(part)[outer], [inner]: value };
        else trace(part)[outer] = value;
      }
    }
    const scene = figure.layout.scene;
    ["xaxis", "yaxis", "zaxis"].forEach((axis, place) => {
      scene[axis].range = [this.centre[place] - this.half, this.centre[place] + this.half];
    });
    scene.aspectmode = "cube";
    scene.camera = this.view;
    const config = { displayModeBar: false, responsive: true };
    await Plotly.newPlot(this.div, figure.data, figure.layout, config);
    this.names.write();
    this.div.on("plotly_relayout", (changes) => {
      if (!changes["scene.camera"]) return;
      this.view = changes["scene.camera"];
      this.names.write();
    });
    const holds = { pointerdown: true, pointerup: false, pointercancel: false, wheel: false };
    for (const [event, held] of Object.entries(holds)) {
      window.addEventListener(event, ({ target }) => {
        this.held = held;
        if (this.div.contains(target)) this._follow();
      }, { capture: true, passive: true });
    }
    new ResizeObserver(() => this.names.write()).observe(this.div);
  }

  /** Keep the names at the spacecraft while a pointer turns the picture: plotly tells of it too late. */
  _follow() {
    if (this.still < CALM_FRAMES) return;
    this.still = 0;
    const step = () => {
      const view = this.div._fullLayout.scene._scene.getCamera();
      this.still = JSON.stringify(view) === JSON.stringify(this.view) ? this.still + 1 : 0;
      if (!this.still) {
        this.view = view;
        this.names.write();
      }
      if (this.held) this.still = 0;
      if (this.still < CALM_FRAMES) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  paths() {
    const points = [];
    const shown = Math.min(this.n, this.run.max_paths);
    for (let j = 0; j < shown; j += 1) {
      for (const k of this.run.path_points) points.push(this.position(k, j));
      points.push([null, null, null]);
    }
    return points;
  }

  /** Points on the paths that are nearer in time to sample k than a tenth of all samples. */
  pathsAbout(k) {
    const near = this.run.path_points.filter((point) => Math.abs(point - k) < this.count / 10);
    return near.flatMap((point) => Array.from({ length: this.n }, (_, j) => this.position(point, j)));
  }

  /** Show sample k; a picture that is still being drawn is waited for. */
  show(k) {
    this.shown = k;
    const changes = this.frame(k);
    const keys = new Set(Object.values(changes).flatMap(Object.keys));
    const update = {};
    const parts = Object.keys(changes);
    for (const key of keys) update[key] = parts.map((part) => changes[part][key]);
    const traces = parts.map((part) => this.parts.indexOf(part));
    this.queue = this.queue.then(() => Plotly.restyle(this.div, update, traces));
    this.names.write();
    return this.queue;
  }

  camera(from, to, distance) {
    const scaled = (point) => point.map((v, k) => (v - this.centre[k]) / (2 * this.half));
    const eye = to.map((v, k) => v + distance * from[k]);
    const asXyz = ([x, y, z]) => ({ x, y, z });
    return { center: asXyz(scaled(to)), eye: asXyz(scaled(eye)), up: { x: 0, y: 0, z: 1 } };
  }

  targetAxis() {
    const v = this.target.vertices;
    const sum = [0, 0, 0];
    for (let place = 0; place < v.length; place += 1) sum[place % 3] += v[place];
    return sum.map((value) => (3 * value) / v.length);
  }

  /** The whole flight. */
  overview() {
    const points = this.paths().filter((point) => point[0] !== null);
    for (let place = 0; place < this.body.vertices.length; place += 9) {
      points.push([...this.body.vertices.subarray(place, place + 3)]);
    }
    return this.fit(this.side(), points);
  }

  /** The target and the spacecraft where they are at time t. */
  swarm(t) {
    const k = sampleAt(this.times, t);
    const points = Array.from({ length: this.n }, (_, j) => this.position(k, j));
    for (let place = 0; place < this.target.vertices.length; place += 3) {
      points.push([...this.target.vertices.subarray(place, place + 3)]);
    }
    return this.fit(this.side(), points);
  }

  /** Direction across the path, to the side where the target is seen and the Sun shines. */
  side() {
    const axis = unit(this.targetAxis());
    const path = this.position(this.count - 1, 0).map((v, k) => v - this.position(0, 0)[k]);
    let side = unit(cross(path, axis));
    if (dot(side, this.sun) < 0) side = side.map((v) => -v);
    return unit(axis.map((v, k) => 0.6 * v + side[k] + (k === 2 ? 0.2 : 0)));
  }

  /** The nearest camera in a direction that has all points in the picture. */
  fit(from, points) {
    const right = unit(cross([0, 0, 1], from));
    const up = cross(from, right);
    const tall = FIELD_OF_VIEW * 0.9;
    const wide = (tall * this.div.clientWidth) / Math.max(1, this.div.clientHeight);
    let to = this.centre;
    let distance = 0;
    for (let round = 0; round < 6; round += 1) {
      const seen = points.map((point) => {
        const arm = point.map((v, k) => v - to[k]);
        return [dot(arm, right), dot(arm, up), dot(arm, from)];
      });
      distance = Math.max(...seen.map(([x, y, near]) => near + Math.max(Math.abs(x) / wide, Math.abs(y) / tall)));
      const middle = [0, 1].map((axis) => {
        const flat = seen.map((spot) => spot[axis] / (distance - spot[2]));
        return ((Math.max(...flat) + Math.min(...flat)) / 2) * distance;
      });
      to = to.map((v, k) => v + 0.8 * (middle[0] * right[k] + middle[1] * up[k]));
    }
    return this.camera(from, to, distance);
  }

  /** Straight down on the target. */
  down() {
    const axis = this.targetAxis();
    const away = unit(axis);
    const v = this.target.vertices;
    let reach = 0;
    for (let place = 0; place < v.length; place += 3) {
      reach = Math.max(reach, Math.hypot(v[place] - axis[0], v[place + 1] - axis[1], v[place + 2] - axis[2]));
    }
    if (Math.abs(away[2]) > 0.95) away[0] += 0.35;
    return this.camera(unit(away), axis, (1.25 * reach) / FIELD_OF_VIEW);
  }

  moveCamera(camera) {
    this.queue = this.queue.then(() => Plotly.relayout(this.div, { "scene.camera": camera }));
    return this.queue;
  }

  /** Turn the camera by angles [rad] about the vertical and the horizontal, and scale its distance. */
  turn(right, up, closer = 1) {
    const { eye, center } = this.div.layout.scene.camera;
    const arm = ["x", "y", "z"].map((axis) => eye[axis] - (center ? center[axis] : 0));
    const distance = Math.hypot(...arm) * closer;
    const azimuth = Math.atan2(arm[1], arm[0]) + right;
    const limit = 1.5;
    const height = Math.max(-limit, Math.min(limit, Math.asin(arm[2] / Math.hypot(...arm)) + up));
    const flat = distance * Math.cos(height);
    const moved = [flat * Math.cos(azimuth), flat * Math.sin(azimuth), distance * Math.sin(height)];
    const base = center || { x: 0, y: 0, z: 0 };
    const next = { x: base.x + moved[0], y: base.y + moved[1], z: base.z + moved[2] };
    return this.moveCamera({ center: base, eye: next, up: { x: 0, y: 0, z: 1 } });
  }
}

/** Lists of x, y and z from points. */
function xyz(points) {
  return { x: points.map((p) => p[0]), y: points.map((p) => p[1]), z: points.map((p) => p[2]) };
}
