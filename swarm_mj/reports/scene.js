// The 3-D picture of one run: fills plotly's traces from packed arrays and moves what moves with time.
"use strict";

const FIELD_OF_VIEW = 0.414; // tangent of half of plotly's vertical field of view
/** After so many pictures without a change the camera rests. */
const CALM_FRAMES = 20;
/** Instants of a path that an overview is fitted to. */
const PATH_SAMPLES = 40;

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
    this.companion = new Mesh(
      packed.companion_vertices ? unpack(packed.companion_vertices) : new Float32Array(0),
      packed.companion_faces ? unpack(packed.companion_faces) : new Int32Array(0),
    );
    for (const name of ["companion_r", "companion_C", "C_AN", "r", "z", "C", "length", "sun", "earth", "rays", "ray_length", "first_seen", "first_seen_passage"]) {
      if (packed[name]) this[name] = unpack(packed[name]);
    }
    this.mode = unpack(run.mode);
    this.times = unpack(run.times);
    this.passage = false;
    this.inertial = true;
    this.scale = "near";
    this.views = true;
    this.directions = false;
    this.held = false;
    this.still = CALM_FRAMES;
    this.queue = Promise.resolve();
    this.bodyRadius = this.body.reach(this.target.reach());
    this.reach = Array.from(this.times, (_, k) => this._reach(k));
  }

  /** Distance from the body's centre within which everything lies at sample k [km]. */
  _reach(k) {
    const spots = Array.from({ length: this.n }, (_, j) => [this.position(k, j), this.tip(k, j)]).flat();
    return Math.max(1.75 * this.bodyRadius, ...spots.map((spot) => Math.hypot(...spot)));
  }

  /** Half the width of the drawn cube about the body's centre [km]: it holds the whole flight, the body, or what is near it,
   * and beyond that twice as much and again, until the spacecraft are inside. */
  halfAt(k) {
    if (this.scale === "all") return 1.05 * this.reach.reduce((a, b) => Math.max(a, b));
    if (this.scale === "body") return 4 * this.bodyRadius;
    const [first, last] = this.run.scene.near;
    const near = 1.05 * this.reach.slice(first, last + 1).reduce((a, b) => Math.max(a, b));
    return near * 2 ** Math.max(0, Math.ceil(Math.log2(this.reach[k] / near)));
  }

  /** A vector in A in the axes that are shown. */
  shownOf(k, v) {
    if (!this.inertial) return Array.from(v);
    const C = this.C_AN.subarray(9 * k, 9 * k + 9);
    return [0, 1, 2].map((axis) => C[axis] * v[0] + C[3 + axis] * v[1] + C[6 + axis] * v[2]);
  }

  /** The inverse. */
  fixedOf(k, v) {
    if (!this.inertial) return v;
    return [0, 3, 6].map((row) => dot(this.C_AN.subarray(9 * k + row, 9 * k + row + 3), v));
  }

  /** Vertices of a mesh at sample k, as x, y and z. */
  vertices(mesh, k) {
    const found = { x: [], y: [], z: [] };
    for (let place = 0; place < mesh.vertices.length; place += 3) {
      const [x, y, z] = this.shownOf(k, mesh.vertices.subarray(place, place + 3));
      found.x.push(x);
      found.y.push(y);
      found.z.push(z);
    }
    return found;
  }

  /** The companion at sample k, with the direction to the Sun turned into its own axes for its light. */
  moon(k, sun) {
    if (!this.companion.faces.length) return { x: [], y: [], z: [], intensity: [] };
    const C = this.companion_C.subarray(9 * k, 9 * k + 9);
    const at = this.companion_r.subarray(3 * k, 3 * k + 3);
    const found = { x: [], y: [], z: [] };
    for (let place = 0; place < this.companion.vertices.length; place += 3) {
      const v = this.companion.vertices.subarray(place, place + 3);
      const [x, y, z] = this.shownOf(k, [0, 3, 6].map((row, axis) => at[axis] + dot(C.subarray(row, row + 3), v)));
      found.x.push(x);
      found.y.push(y);
      found.z.push(z);
    }
    const turned = [0, 1, 2].map((axis) => C[axis] * sun[0] + C[3 + axis] * sun[1] + C[6 + axis] * sun[2]);
    return { ...found, intensity: Mesh.light(this.companion.vertexNormals, turned) };
  }

  inBox(point) {
    return point.every((v) => Math.abs(v) <= this.half);
  }

  right() {
    const [eye, to, up] = [this.view.eye, this.view.center, this.view.up].map(({ x, y, z }) => [x, y, z]);
    return unit(cross(to.map((v, axis) => v - eye[axis]), up));
  }

  position(k, j) {
    const place = 3 * (k * this.n + j);
    return this.shownOf(k, this.r.subarray(place, place + 3));
  }

  /** Where the line along +z of spacecraft j ends. */
  tip(k, j) {
    const place = k * this.n + j;
    const z = this.shownOf(k, this.z.subarray(3 * place, 3 * place + 3));
    return Array.from(this.position(k, j), (v, axis) => v + this.length[place] * z[axis]);
  }

  observing(k, j) {
    return this.modes[this.mode[k * this.n + j]].observing;
  }

  /** Border of the picture that spacecraft j takes, pulled off the ground a little. */
  border(k, j) {
    const rays = this.rays.length / 3;
    const watching = this.ray_length.length / (this.count * rays);
    const turn = 9 * (k * watching + j);
    const place = 3 * (k * this.n + j);
    const from = Array.from(this.r.subarray(place, place + 3));
    return Array.from({ length: rays }, (_, ray) => {
      const length = 0.994 * this.ray_length[(k * watching + j) * rays + ray];
      if (Number.isNaN(length)) return [null, null, null];
      return this.shownOf(k, from.map((v, axis) => {
        let along = 0;
        for (let b = 0; b < 3; b += 1) along += this.C[turn + 3 * b + axis] * this.rays[3 * ray + b];
        return v + length * along;
      }));
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
      body: { ...this.vertices(this.body, k), intensity: Mesh.light(this.body.vertexNormals, sun) },
      companion: this.moon(k, sun),
      target: { ...this.vertices(this.target, k), intensity: this.cells(k, sun) },
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
      const toward = this.shownOf(k, directions.subarray(3 * k, 3 * k + 3));
      const at = (share) => Array.from(toward, (v) => share * this.bodyRadius * v);
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
      const arm = point.map((v, k) => v / (2 * this.half) - eye[k]);
      const ahead = dot(arm, forward);
      return ahead > 0 ? [(scale * dot(arm, right)) / ahead, (-scale * dot(arm, up)) / ahead] : null;
    });
  }

  /** As `flat`, but none of points behind the body. */
  seen(points) {
    const eye = [this.view.eye.x, this.view.eye.y, this.view.eye.z].map((v) => 2 * this.half * v);
    const [from, fixed] = [this.fixedOf(this.shown, eye), (point) => this.fixedOf(this.shown, point)];
    const covered = (point) => [this.body, this.target].some((mesh) => mesh.stands(from, fixed(point)));
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
    this.shown = k;
    this.half = this.halfAt(k);
    this.view = this.overview();
    this.body.fill(trace("body"));
    this.companion.fill(trace("companion"));
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
    for (const axis of ["xaxis", "yaxis", "zaxis"]) scene[axis].range = [-this.half, this.half];
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
    if (this.scale === "near" && this.halfAt(k) !== this.half) this._rescale();
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

  /** Draw twice as much or half as much about the point that is looked at. */
  _rescale() {
    const { eye, center, up } = this.view;
    const share = this.half / this.halfAt(this.shown);
    const [x, y, z] = ["x", "y", "z"].map((axis) => share * center[axis]);
    this.moveCamera({ eye: { x: x + eye.x - center.x, y: y + eye.y - center.y, z: z + eye.z - center.z }, center: { x, y, z }, up });
  }

  /** Draw at a scale, all, near or body, from where a function says. */
  look(scale, camera) {
    this.scale = scale;
    this.half = this.halfAt(this.shown);
    return this.moveCamera(camera());
  }

  /** Draw in inertial axes or in those of the body. */
  setAxes(inertial) {
    this.inertial = inertial;
    this.half = this.halfAt(this.shown);
    this.moveCamera(this.scale === "body" ? this.down() : this.overview());
    const lines = [this.paths(), [this.position(0, 0)]].map(xyz);
    const update = Object.fromEntries(["x", "y", "z"].map((axis) => [axis, lines.map((line) => line[axis])]));
    const traces = ["paths", "mothership"].map((part) => this.parts.indexOf(part));
    this.queue = this.queue.then(() => Plotly.restyle(this.div, update, traces));
  }

  camera(from, to, distance) {
    const scaled = (point) => Array.from(point, (v) => v / (2 * this.half));
    const eye = to.map((v, k) => v + distance * from[k]);
    const asXyz = ([x, y, z]) => ({ x, y, z });
    return { center: asXyz(scaled(to)), eye: asXyz(scaled(eye)), up: { x: 0, y: 0, z: 1 } };
  }

  targetAxis() {
    const v = this.target.vertices;
    const sum = [0, 0, 0];
    for (let place = 0; place < v.length; place += 1) sum[place % 3] += v[place];
    return this.shownOf(this.shown, sum.map((value) => (3 * value) / v.length));
  }

  /** The flight, or what of it is near the body. */
  overview() {
    const [first, last] = this.scale === "all" ? [0, this.count - 1] : this.run.scene.near;
    const points = this.points(this.body, 3);
    const shown = Math.min(this.n, this.run.max_paths);
    const step = Math.ceil((last - first) / PATH_SAMPLES) || 1;
    for (let k = first; k <= last; k += step) for (let j = 0; j < shown; j += 1) points.push(this.position(k, j));
    return this.fit(this.side(first, last), points);
  }

  /** The target and the spacecraft where they are. */
  swarm() {
    const points = Array.from({ length: this.n }, (_, j) => this.position(this.shown, j));
    return this.fit(this.side(...this.run.scene.near), [...points, ...this.points(this.target, 1)]);
  }

  /** Some vertices of a mesh where they are. */
  points(mesh, every) {
    const { x, y, z } = this.vertices(mesh, this.shown);
    return x.map((_, n) => [x[n], y[n], z[n]]).filter((_, n) => n % every === 0);
  }

  /** Direction across the path, to the side where the target is seen and the Sun shines, or that the target faces in the dark. */
  side(first, last) {
    const axis = unit(this.targetAxis());
    const path = Array.from(this.position(last, 0), (v, k) => v - this.position(first, 0)[k]);
    const faced = [0, 1, 2].map((k) => this.target.faceNormals.reduce((sum, v, place) => sum + (place % 3 === k ? v : 0), 0));
    const sun = [...this.sun.subarray(3 * this.shown, 3 * this.shown + 3)];
    let side = unit(cross(path, axis));
    if (dot(side, this.shownOf(this.shown, dot(faced, sun) > 0 ? sun : faced)) < 0) side = side.map((v) => -v);
    return unit(axis.map((v, k) => 0.6 * v + side[k] + (k === 2 ? 0.2 : 0)));
  }

  /** The nearest camera in a direction that has all points in the picture. */
  fit(from, points) {
    const right = unit(cross([0, 0, 1], from));
    const up = cross(from, right);
    const tall = FIELD_OF_VIEW * 0.9;
    const wide = (tall * this.div.clientWidth) / Math.max(1, this.div.clientHeight);
    let to = [0, 0, 0];
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
    const reach = Math.max(...this.points(this.target, 1).map((spot) => Math.hypot(...spot.map((v, k) => v - axis[k]))));
    if (Math.abs(away[2]) > 0.95) away[0] += 0.35;
    return this.camera(unit(away), axis, (1.25 * reach) / FIELD_OF_VIEW);
  }

  moveCamera(camera) {
    this.half = this.halfAt(this.shown);
    this.view = camera;
    const changes = { "scene.camera": camera };
    for (const axis of ["xaxis", "yaxis", "zaxis"]) changes[`scene.${axis}.range`] = [-this.half, this.half];
    this.queue = this.queue.then(() => Plotly.relayout(this.div, changes));
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
