// Words over a 3-D picture: names beside the spacecraft, Sun and Earth at the ends of their lines. plotly's own words would
// have to be made into meshes of glyphs at each instant.
"use strict";

/** Size of a letter of a name, distance of a name from its marker, and room between names [px]. */
const LETTER = { width: 7, height: 13, away: 7, room: 4 };
const PLACES = [
  "top center", "top right", "middle right", "bottom right", "bottom center", "bottom left", "middle left", "top left",
];

class Names {
  constructor(scene, element) {
    this.scene = scene;
    this.element = element;
  }

  /** Write the names of the instant and the view that the picture shows. */
  write() {
    const k = this.scene.shown;
    const fixed = [...this.ofSpeck(), ...this.ofSigns(k)];
    const labels = [...fixed, ...this.ofSpacecraft(k, fixed)];
    const [middle, centre] = [this.scene.div.clientWidth / 2, this.scene.div.clientHeight / 2];
    while (this.element.children.length < labels.length) this.element.append(document.createElement("span"));
    [...this.element.children].forEach((span, number) => {
      span.hidden = number >= labels.length;
      if (span.hidden) return;
      const { word, box } = labels[number];
      span.textContent = word;
      span.style.transform = `translate(${middle + box[0]}px, ${centre + box[1]}px)`;
      span.style.width = `${box[2] - box[0]}px`;
    });
  }

  /** The name of the body where it is too small to be found without. */
  ofSpeck() {
    const [spot, rim] = this.scene.flat([[0, 0, 0], this.scene.right().map((v) => v * this.scene.bodyRadius)]);
    if (!spot || !rim || Math.hypot(rim[0] - spot[0], rim[1] - spot[1]) > LETTER.height || !this.holds([...spot, ...spot])) return [];
    return [{ word: this.scene.run.body, box: boxOf(spot, this.scene.run.body, "middle right") }];
  }

  /** The words Sun and Earth and their boxes at the ends of their lines, clear of each other. */
  ofSigns(k) {
    const signs = this.scene.signs(k);
    const found = [];
    this.scene.seen(signs.map(({ to }) => to)).forEach((tip, j) => {
      if (!tip) return;
      const { word } = signs[j];
      const boxes = PLACES.map((place) => boxOf(tip, word, place));
      found.push({ word, box: boxes.find((box) => !found.some((other) => overlap(box, other.box))) ?? boxes[0] });
    });
    return found;
  }

  /** Names of the spacecraft and their boxes, each where it covers least; one for those that stand too close for two. */
  ofSpacecraft(k, fixed) {
    if (this.scene.n > this.scene.run.max_named) return [];
    const spots = Array.from({ length: this.scene.n }, (_, j) => this.scene.position(k, j));
    const places = this.scene.seen(spots).map((at, j) =>
      at && this.scene.inBox(spots[j]) && this.holds([...at, ...at]) ? at : null);
    const sights = spots.flatMap((spot, j) => this.scene.flat(between(spot, this.scene.tip(k, j))));
    const lines = [...this.scene.flat(this.scene.pathsAbout(k)), ...sights].filter(Boolean);
    let found = null;
    for (let reach = LETTER.away; !found; reach *= 1.6) found = this.ofCrowds(crowds(places, reach), places, lines, fixed);
    this.last = new Set(found.map(({ j, place }) => `${j} ${place}`));
    return found;
  }

  /** Where the names of groups of spacecraft stand; null if two of several would cover each other or a marker. */
  ofCrowds(groups, places, lines, fixed) {
    const found = [];
    const taken = fixed.map(({ box }) => box);
    for (const group of groups) {
      const word = group.map((j) => this.scene.run.names[j]).join(" ");
      const others = places.filter((spot, j) => spot && !group.includes(j));
      let best = null;
      for (const j of group) {
        for (const place of PLACES) {
          const box = boxOf(places[j], word, place);
          const clash = !this.holds(box) || others.some(inside(box)) || taken.some((other) => overlap(box, other));
          const kept = this.last?.has(`${j} ${place}`) ? 2 : 0; // else names would jump about
          const cost = lines.filter(inside(box)).length + (clash ? 1000 : 0) - kept;
          if (!best || cost < best.cost) best = { cost, j, place, box, word };
        }
      }
      if (best.cost > 900 && groups.length > 1) return null;
      found.push(best);
      taken.push(best.box);
    }
    return found;
  }

  /** Whether a box lies in the picture. */
  holds([left, top, right, bottom]) {
    const [wide, tall] = [this.scene.div.clientWidth / 2, this.scene.div.clientHeight / 2];
    return left > -wide && right < wide && top > -tall && bottom < tall;
  }
}

/** Points on the way from one point to another. */
const between = (start, end) =>
  Array.from({ length: 40 }, (_, n) => start.map((v, axis) => v + ((n + 1) / 40) * (end[axis] - v)));

/** Groups of places that are nearer to each other than a reach [px]; places out of sight are left out. */
function crowds(places, reach) {
  const left = places.map((_, j) => j).filter((j) => places[j]);
  const groups = [];
  while (left.length) {
    const group = [left.shift()];
    for (const j of group) {
      const near = left.filter((m) => Math.hypot(places[m][0] - places[j][0], places[m][1] - places[j][1]) < reach);
      group.push(...near);
      for (const m of near) left.splice(left.indexOf(m), 1);
    }
    groups.push(group.sort((a, b) => a - b));
  }
  return groups;
}

/** Left, top, right and bottom of a word at a place beside a marker [px]. */
function boxOf([x, y], word, place) {
  const [wide, away] = [LETTER.width * word.length, LETTER.away];
  const [row, column] = place.split(" ");
  const left = x + { left: -away - wide, center: -wide / 2, right: away }[column];
  const gap = column === "center" ? away : 0;
  const top = y + { top: -gap - LETTER.height, middle: -LETTER.height / 2, bottom: gap }[row];
  return [left, top, left + wide, top + LETTER.height];
}

const inside = ([left, top, right, bottom]) => ([x, y]) => x > left && x < right && y > top && y < bottom;

const overlap = (a, b) =>
  a[0] < b[2] + LETTER.room && b[0] < a[2] + LETTER.room && a[1] < b[3] + LETTER.room && b[1] < a[3] + LETTER.room;
