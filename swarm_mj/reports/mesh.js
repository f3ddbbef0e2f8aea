// Vectors, packed arrays, times and meshes.
"use strict";

const unit = (v) => {
  const length = Math.hypot(...v) || 1;
  return v.map((c) => c / length);
};
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Decode {type, shape, data} to a typed array. */
function unpack(packed) {
  const bytes = bytesOf(packed.data);
  const kinds = { f8: Float64Array, f4: Float32Array, i4: Int32Array, i1: Int8Array };
  return new kinds[packed.type](bytes.buffer);
}

/** The bytes of base64; what browsers bring along for it is ten times as fast, but new. */
function bytesOf(base64) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(base64);
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let place = 0; place < bytes.length; place += 1) bytes[place] = text.charCodeAt(place);
  return bytes;
}

/** Columns x, y, z of rows of three. */
const columns = (rows) => [0, 1, 2].map((axis) => rows.filter((_, place) => place % 3 === axis));

/** Number of the last of ascending times that is not after t. */
function sampleAt(times, t) {
  let low = 0;
  let high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t + 1e-6) low = middle;
    else high = middle - 1;
  }
  return low;
}

/** Number of the nearest of ascending times. */
function nearest(times, t) {
  const k = sampleAt(times, t);
  return k + 1 < times.length && times[k + 1] - t < t - times[k] ? k + 1 : k;
}

/** Light where the Sun is at the horizon; it falls to 0 where it stands at the nadir, so that the night side shows its ground. */
const TWILIGHT = 0.25;

class Mesh {
  constructor(vertices, faces) {
    this.vertices = vertices;
    this.faces = faces;
    const faceCount = faces.length / 3;
    this.faceNormals = new Float32Array(faces.length);
    this.vertexNormals = new Float32Array(vertices.length);
    const corner = (place) => [0, 1, 2].map((axis) => vertices[3 * faces[place] + axis]);
    for (let face = 0; face < faceCount; face += 1) {
      const [a, b, c] = [corner(3 * face), corner(3 * face + 1), corner(3 * face + 2)];
      const normal = cross(b.map((v, k) => v - a[k]), c.map((v, k) => v - a[k]));
      this.faceNormals.set(unit(normal), 3 * face);
      for (let k = 0; k < 3; k += 1) {
        for (let axis = 0; axis < 3; axis += 1) this.vertexNormals[3 * faces[3 * face + k] + axis] += normal[axis];
      }
    }
    for (let place = 0; place < vertices.length; place += 3) {
      this.vertexNormals.set(unit([...this.vertexNormals.subarray(place, place + 3)]), place);
    }
  }

  /** Distance of the farthest vertex from the centre, at least some value. */
  reach(least = 0) {
    const v = this.vertices;
    let farthest = least;
    for (let n = 0; n < v.length; n += 3) farthest = Math.max(farthest, Math.hypot(v[n], v[n + 1], v[n + 2]));
    return farthest;
  }

  /** Light from 0 to 1 on each normal under a distant Sun. */
  static light(normals, sun) {
    const light = new Float32Array(normals.length / 3);
    for (let n = 0; n < light.length; n += 1) {
      const cosine = normals[3 * n] * sun[0] + normals[3 * n + 1] * sun[1] + normals[3 * n + 2] * sun[2];
      light[n] = TWILIGHT + (cosine > 0 ? 1 - TWILIGHT : TWILIGHT) * cosine;
    }
    return light;
  }

  /** Whether a face stands between two points (Moeller and Trumbore 1997). */
  stands(from, to) {
    const { vertices, faces } = this;
    const way = to.map((v, k) => v - from[k]);
    for (let face = 0; face < faces.length; face += 3) {
      const [a, b, c] = [3 * faces[face], 3 * faces[face + 1], 3 * faces[face + 2]];
      const [ax, ay, az] = [vertices[a], vertices[a + 1], vertices[a + 2]];
      const [ux, uy, uz] = [vertices[b] - ax, vertices[b + 1] - ay, vertices[b + 2] - az];
      const [vx, vy, vz] = [vertices[c] - ax, vertices[c + 1] - ay, vertices[c + 2] - az];
      const [px, py, pz] = [way[1] * vz - way[2] * vy, way[2] * vx - way[0] * vz, way[0] * vy - way[1] * vx];
      const scale = ux * px + uy * py + uz * pz;
      const [sx, sy, sz] = [from[0] - ax, from[1] - ay, from[2] - az];
      const first = (sx * px + sy * py + sz * pz) / scale;
      if (!(first >= 0 && first <= 1)) continue;
      const [qx, qy, qz] = [sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux];
      const second = (way[0] * qx + way[1] * qy + way[2] * qz) / scale;
      const share = (vx * qx + vy * qy + vz * qz) / scale;
      if (second >= 0 && first + second <= 1 && share > 0 && share < 1) return true;
    }
    return false;
  }

  fill(trace) {
    [trace.x, trace.y, trace.z] = columns(this.vertices);
    [trace.i, trace.j, trace.k] = columns(this.faces);
  }
}
