// The page: one clock that the slider, the play button, the plots and every 3-D picture share.
"use strict";

/** Frames after which the body to turn is drawn as it stays. */
const SETTLED = 6;
const DATA = JSON.parse(document.getElementById("report-data").textContent);
const INK = DATA.ink;
const find = (id) => document.getElementById(id);
const LIGHT = window.matchMedia("(prefers-color-scheme: light)");

const page = {
  ticks: [],
  tick: 0,
  playing: false,
  touched: false,
  busy: false,
  scenes: [],
  plots: find("plots"),
};

function colours() {
  const style = getComputedStyle(document.documentElement);
  const value = (name) => style.getPropertyValue(name).trim();
  return { ink: value("--ink"), grid: value("--grid"), card: value("--card"), soft: value("--soft") };
}

/** A copy of a plotly figure in the colours of the page. */
function themed(figure) {
  const { ink, grid, card } = colours();
  const text = JSON.stringify(figure).replaceAll(JSON.stringify(INK), JSON.stringify(ink));
  const copy = JSON.parse(text);
  copy.layout.paper_bgcolor = "rgba(0,0,0,0)";
  copy.layout.plot_bgcolor = "rgba(0,0,0,0)";
  copy.layout.font = { color: ink, family: "system-ui, sans-serif", size: 12 };
  copy.layout.hoverlabel = { bgcolor: card, bordercolor: grid, font: { color: ink } };
  for (const [key, axis] of Object.entries(copy.layout)) {
    if (/^[xy]axis/.test(key)) Object.assign(axis, { gridcolor: grid, zerolinecolor: grid, linecolor: grid });
  }
  return copy;
}

function clockText(t) {
  const whole = Math.round(t);
  const seconds = String(whole % 60).padStart(2, "0");
  const minutes = Math.floor(whole / 60) % 60;
  const hours = Math.floor(whole / 3600);
  return hours ? `${hours} h ${String(minutes).padStart(2, "0")} min ${seconds} s` : `${minutes} min ${seconds} s`;
}

/** A number as in the tables: small ones with their power of ten. */
function short(value) {
  if (Number.isNaN(value)) return "–";
  if (value === 0 || value >= 0.01) return String(Number(value.toPrecision(3)));
  const [mantissa, exponent] = value.toExponential(1).split("e");
  return `${mantissa}·10${[...exponent].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("")}`;
}

class RunView {
  constructor(run, number) {
    this.run = run;
    this.number = number;
    for (const name of ["times", "pointing", "wheel", "mode", "link"]) {
      this[name] = unpack(run[name]);
    }
    this.swarmShare = { own: unpack(run.percent), passage: unpack(run.percent_passage) };
    this.ownShare = { own: unpack(run.percent_by), passage: unpack(run.percent_by_passage) };
    this.n = run.names.length;
    this.scene = new SceneView(run, find(`scene-${number}`), find(`labels-${number}`), DATA.modes);
    this.cells = this._table(find(`now-${number}`));
  }

  _table(table) {
    if (!table) return [];
    return [...table.tBodies[0].rows].map((row) => [...row.cells]);
  }

  shareAt(k) {
    return this.swarmShare[this.criterion][k];
  }

  /** By which pictures the faces shown count: the scenario's own, or those of the whole passage. */
  get criterion() {
    return this.scene.passage ? "passage" : "own";
  }

  fillTable(k) {
    this.cells.forEach((cells, row) => {
      const j = this.run.rows[row];
      const place = k * this.n + j;
      const mode = DATA.modes[this.mode[place]];
      const values = [
        mode.meaning,
        `${short(this.pointing[place])}`,
        this.wheel[place].toFixed(0),
        this.link[place] ? "closed" : "open",
        j < this.run.observers ? this.ownShare[this.criterion][place].toFixed(2) : "–",
      ];
      values.forEach((text, column) => {
        if (cells[column + 1].textContent !== text) cells[column + 1].textContent = text;
      });
      cells[0].style.setProperty("--mode", mode.colour);
    });
  }
}

/** Write the numbers of one instant. */
function tell(tick) {
  const t = page.ticks[tick];
  page.shown = tick;
  const shares = page.runs.map((view) => {
    const k = sampleAt(view.times, t);
    view.fillTable(k);
    return view.shareAt(k);
  });
  const share = shares.map((value) => `${value.toFixed(2)} %`).join(" | ");
  find("clock").textContent = clockText(t);
  find("share").textContent = share;
  const slider = find("slider");
  slider.setAttribute("aria-valuetext", `${clockText(t)}, observed ${share}`);
}

/** Show one instant everywhere. */
async function show(tick) {
  tell(tick);
  if (page.busy) return;
  page.busy = true;
  let drawn = -1;
  while (drawn !== page.shown) {
    drawn = page.shown;
    const now = page.ticks[drawn];
    placeCursor(now / DATA.axis_seconds);
    await Promise.all(page.runs.map((view) => view.scene.show(sampleAt(view.times, now))));
  }
  page.busy = false;
  document.body.dataset.shown = String(drawn);
}

/** Move the line that marks the time in the plots; a plotly shape would lay all of them out again. */
function placeCursor(x) {
  const area = page.plots.querySelector('.nsewdrag[data-subplot="xy"]');
  const lowest = page.plots.querySelector('.nsewdrag[data-subplot="x4y4"]');
  const cursor = find("cursor");
  const [first, last] = page.plots.layout.xaxis.range;
  const share = (x - first) / (last - first);
  cursor.hidden = !(area && lowest) || share < 0 || share > 1;
  if (cursor.hidden) return;
  const [top, bottom] = [area.getBoundingClientRect(), lowest.getBoundingClientRect()];
  const box = cursor.parentElement.getBoundingClientRect();
  cursor.style.transform = `translate(${top.left - box.left + share * top.width}px, ${top.top - box.top}px)`;
  cursor.style.height = `${bottom.bottom - top.top}px`;
}

function setTick(tick) {
  page.tick = Math.max(0, Math.min(page.ticks.length - 1, tick));
  find("slider").value = page.tick;
  return show(page.tick);
}

function setPlaying(playing) {
  page.playing = playing;
  const button = find("play");
  button.setAttribute("aria-label", playing ? "Pause" : "Play");
  button.querySelector(".face").textContent = playing ? "❚❚" : "►";
  if (!playing) return;
  if (!page.touched || page.tick >= page.ticks.length - 1) setTick(0);
  page.touched = true;
  let t = page.ticks[page.tick];
  let before = performance.now();
  const advance = (now) => {
    if (!page.playing) return;
    t += ((now - before) / 1000) * Number(find("speed").value);
    before = now;
    const tick = sampleAt(page.ticks, t);
    if (tick !== page.tick) setTick(tick);
    if (tick >= page.ticks.length - 1) setPlaying(false);
    else requestAnimationFrame(advance);
  };
  requestAnimationFrame(advance);
}

function connectControls() {
  const slider = find("slider");
  slider.max = page.ticks.length - 1;
  slider.addEventListener("input", () => {
    page.touched = true;
    setPlaying(false);
    setTick(Number(slider.value));
  });
  find("play").addEventListener("click", () => setPlaying(!page.playing));
  find("theme").addEventListener("click", switchTheme);
  for (const part of ["views", "directions"]) {
    find(part).addEventListener("change", (event) => {
      for (const view of page.runs) view.scene[part] = event.target.checked;
      show(page.shown);
    });
  }
  find("axes").addEventListener("change", (event) => {
    for (const view of page.runs) view.scene.setAxes(event.target.value === "inertial");
    show(page.shown);
  });
  find("criterion")?.addEventListener("change", (event) => {
    for (const view of page.runs) view.scene.passage = event.target.value === "passage";
    show(page.shown);
  });
  find("only-differences")?.addEventListener("change", (event) => {
    find("parameters").classList.toggle("all", !event.target.checked);
  });
  for (const button of document.querySelectorAll("[data-view]")) {
    button.addEventListener("click", () => cameraViews[button.dataset.view](page.runs[Number(button.dataset.run)].scene));
  }
  document.addEventListener("keydown", pressed);
}

const STEP = Math.PI / 12;
const cameraViews = {
  swarm: (scene) => scene.look("near", () => scene.swarm()),
  near: (scene) => scene.look("near", () => scene.overview()),
  overview: (scene) => scene.look("all", () => scene.overview()),
  target: (scene) => scene.look("body", () => scene.down()),
  closer: (scene) => scene.turn(0, 0, 0.8),
  away: (scene) => scene.turn(0, 0, 1.25),
  left: (scene) => scene.turn(-STEP, 0),
  right: (scene) => scene.turn(STEP, 0),
  up: (scene) => scene.turn(0, STEP / 2),
  down: (scene) => scene.turn(0, -STEP / 2),
};
const SCENE_KEYS = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down", "+": "closer", "-": "away" };

function pressed(event) {
  const scene = event.target.closest?.("[data-scene]");
  if (scene && SCENE_KEYS[event.key]) {
    event.preventDefault();
    cameraViews[SCENE_KEYS[event.key]](page.runs[Number(scene.dataset.scene)].scene);
  } else if (event.key === " " && !event.target.closest?.("button, input, select, a, summary")) {
    event.preventDefault();
    setPlaying(!page.playing);
  }
}

function connectPlots() {
  const moveCursor = () => placeCursor(page.ticks[page.shown] / DATA.axis_seconds);
  page.plots.on("plotly_afterplot", moveCursor);
  new ResizeObserver(moveCursor).observe(page.plots);
  page.plots.on("plotly_hover", (event) => {
    if (!page.playing) show(nearest(page.ticks, event.points[0].x * DATA.axis_seconds));
  });
  page.plots.on("plotly_unhover", () => {
    if (!page.playing) show(page.tick);
  });
  page.plots.on("plotly_click", (event) => {
    page.touched = true;
    setPlaying(false);
    setTick(nearest(page.ticks, event.points[0].x * DATA.axis_seconds));
  });
}

function switchTheme() {
  const dark = document.documentElement.dataset.theme
    ? document.documentElement.dataset.theme === "dark"
    : !LIGHT.matches;
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  recolour();
}

function recolour() {
  const plots = themed(DATA.plots);
  fitPlots(plots.layout);
  Plotly.react(page.plots, plots.data, plots.layout);
  for (const [id, figure] of Object.entries(DATA.ways)) {
    const way = themed(figure);
    Plotly.react(find(id), way.data, way.layout);
  }
  const { ink } = colours();
  for (const view of page.runs) {
    const { scene } = view;
    const at = (...parts) => parts.map((part) => scene.parts.indexOf(part));
    Plotly.restyle(scene.div, { "line.color": ink }, at("views", "directions"));
    Plotly.restyle(scene.div, { "marker.color": ink }, at("mothership"));
  }
}

/** Smaller letters where the page is narrow. */
function fitPlots(layout) {
  const narrow = page.plots.clientWidth < 520;
  layout.font.size = narrow ? 11 : 12;
}

/** Run plotly's script, which the page holds compressed. */
async function loadPlotly() {
  const packed = new Blob([bytesOf(find("plotly").textContent)]);
  const script = document.createElement("script");
  script.textContent = await new Response(packed.stream().pipeThrough(new DecompressionStream("deflate"))).text();
  document.head.append(script);
}

async function start() {
  const loaded = loadPlotly();
  page.runs = DATA.runs.map((run, number) => new RunView(run, number));
  page.ticks = page.runs.reduce((a, b) => (b.times.at(-1) > a.times.at(-1) ? b : a)).times;
  page.tick = page.shown = sampleAt(page.ticks, DATA.arrival_s);
  find("slider").max = page.ticks.length - 1;
  find("slider").value = page.tick;
  tell(page.tick);
  await loaded;
  for (const view of page.runs) {
    await view.scene.start(themed(view.run.figure), sampleAt(view.times, page.ticks[page.tick]));
  }
  const plots = themed(DATA.plots);
  fitPlots(plots.layout);
  await Plotly.newPlot(page.plots, plots.data, plots.layout, { displayModeBar: false, responsive: true });
  for (const [id, figure] of Object.entries(DATA.ways)) {
    const way = themed(figure);
    await Plotly.newPlot(find(id), way.data, way.layout, { displayModeBar: false, responsive: true });
  }
  for (let frame = 0; frame < SETTLED; frame += 1) await new Promise(requestAnimationFrame);
  connectControls();
  connectPlots();
  LIGHT.addEventListener("change", recolour);
  placeCursor(page.ticks[page.tick] / DATA.axis_seconds);
  document.body.dataset.shown = String(page.tick);
  document.body.dataset.ready = String(Math.round(performance.now()));
}

start().catch((error) => {
  const words = document.createElement("p");
  words.className = "warning";
  words.textContent = `The replay and the plots cannot be drawn in this browser (${error.message}); the tables can be read.`;
  find("replay").append(words);
  throw error;
});
