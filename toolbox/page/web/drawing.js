// What is drawn on canvases by hand: phase plane, map, poles and the machine in motion. Curves in time are uPlot's.
"use strict";

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();

function floats(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

// A canvas at the resolution of the screen, cleared: [context, width, height] in CSS pixels.
function cleared(canvas) {
  const scale = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "12px system-ui, sans-serif";
  return [context, width, height];
}

function ticks(low, high, count) {
  const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((part) => part * power).find((each) => each >= rough);
  const found = [];
  for (let value = Math.ceil(low / step - 1e-9) * step; value <= high + 1e-9 * step; value += step) found.push(Math.abs(value) < 1e-9 * step ? 0 : value);
  return found;
}

// Numbers beside an axis, with as many digits as tell one tick from the next.
function told_apart(values) {
  if (values.length < 2) return values.map(short);
  const step = Math.abs(values[1] - values[0]), size = Math.max(...values.map(Math.abs));
  if (size >= 1e5 || (size > 0 && size < 1e-3)) return values.map((value) => value === 0 ? "0" : value.toExponential(Math.max(0, Math.ceil(Math.log10(size / step) - 0.01))));
  return values.map((value) => value.toFixed(Math.max(0, Math.ceil(-Math.log10(step) - 0.01))));
}

const short = (value) => {
  if (!isFinite(value)) return "-";
  const size = Math.abs(value);
  return size !== 0 && (size >= 1e5 || size < 1e-3) ? value.toExponential(2) : String(Number(value.toPrecision(4)));
};

// Axes of a plane: [to x pixels, to y pixels, from pixels].
function axes(context, width, height, xs, ys, names) {
  const left = 58, right = 10, top = 8, bottom = 34;
  const x = (value) => left + (value - xs[0]) / (xs[1] - xs[0]) * (width - left - right);
  const y = (value) => height - bottom - (value - ys[0]) / (ys[1] - ys[0]) * (height - top - bottom);
  const back = (px, py) => [xs[0] + (px - left) / (width - left - right) * (xs[1] - xs[0]), ys[0] + (height - bottom - py) / (height - top - bottom) * (ys[1] - ys[0])];
  context.strokeStyle = colour("line");
  context.fillStyle = colour("faint");
  context.lineWidth = 1;
  context.textAlign = "center";
  const across = ticks(xs[0], xs[1], Math.max(2, width / 90)), up = ticks(ys[0], ys[1], Math.max(2, height / 55));
  const acrossWords = told_apart(across), upWords = told_apart(up);
  for (const [i, value] of across.entries()) {
    context.beginPath(); context.moveTo(x(value), top); context.lineTo(x(value), height - bottom); context.stroke();
    context.fillText(acrossWords[i], x(value), height - bottom + 14);
  }
  context.textAlign = "right";
  for (const [i, value] of up.entries()) {
    context.beginPath(); context.moveTo(left, y(value)); context.lineTo(width - right, y(value)); context.stroke();
    context.fillText(upWords[i], left - 4, y(value) + 4);
  }
  context.textAlign = "center";
  context.fillStyle = colour("ink");
  context.fillText(names[0], left + (width - left - right) / 2, height - 5);
  context.save();
  context.translate(11, top + (height - top - bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.fillText(names[1], 0, 0);
  context.restore();
  return [x, y, back];
}

function extent(...rows) {
  let low = Infinity, high = -Infinity;
  for (const row of rows) for (const value of row) { if (value < low) low = value; if (value > high) high = value; }
  if (!(high > low)) { const room = Math.abs(high) * 0.1 || 1; low -= room; high += room; }
  const room = 0.05 * (high - low);
  return [low - room, high + room];
}

const named = (signal) => signal.name.replaceAll(".", " ").replaceAll("_", " ") + (signal.unit === "1" ? "" : " [" + signal.unit + "]");

function drawPlane(canvas, live, pinned) {
  const [context, width, height] = cleared(canvas);
  const rows = (each) => each.plane.map((signal) => signal.floats);
  const all = pinned ? [rows(live), rows(pinned)] : [rows(live)];
  const [x, y] = axes(context, width, height, extent(...all.map((row) => row[0])), extent(...all.map((row) => row[1])), live.plane.map(named));
  const curve = (each, stroke, thick) => {
    const [us, vs] = rows(each);
    for (const stuck of [false, true]) {
      context.beginPath();
      context.strokeStyle = stroke;
      context.lineWidth = stuck ? thick * 2.6 : thick;
      for (let i = 1; i < us.length; i++) {
        if ((each.stuckFloats[i] > 0 && each.stuckFloats[i - 1] > 0) !== stuck) continue;
        context.moveTo(x(us[i - 1]), y(vs[i - 1]));
        context.lineTo(x(us[i]), y(vs[i]));
      }
      context.stroke();
    }
  };
  if (pinned) { context.setLineDash([5, 3]); curve(pinned, colour("pin"), 1.2); context.setLineDash([]); }
  curve(live, colour("c0"), 1.5);
  canvas.setAttribute("aria-label", "Phase plane: " + named(live.plane[1]) + " over " + named(live.plane[0]));
}

function drawPoles(canvas, poles) {
  const [context, width, height] = cleared(canvas);
  if (!poles.length) { context.fillStyle = colour("faint"); context.fillText("none", 20, 24); return; }
  // the slow ones tell: what is far to the left is left out of the axis
  const sizes = poles.map((pole) => Math.hypot(pole[0], pole[1])).filter((size) => size > 1e-9).sort((a, b) => a - b);
  const swings = poles.filter((pole) => Math.abs(pole[1]) > 1e-9).map((pole) => Math.hypot(pole[0], pole[1])).sort((a, b) => a - b);
  const growing = poles.filter((pole) => pole[0] > 0).map((pole) => Math.hypot(pole[0], pole[1]));
  const reach = Math.max(6 * (sizes[0] || 1), 6 * (swings[0] || 0), ...growing);
  const near = poles.filter((pole) => Math.hypot(pole[0], pole[1]) <= reach);
  const xs = extent(near.map((pole) => pole[0]), [0]), ys = extent(near.map((pole) => pole[1]), near.map((pole) => -pole[1]));
  const [x, y] = axes(context, width, height, xs, ys, ["growth rate [1/s]", "frequency [rad/s]"]);
  context.strokeStyle = colour("ink");
  context.lineWidth = 1.4;
  context.beginPath(); context.moveTo(x(0), y(ys[0])); context.lineTo(x(0), y(ys[1])); context.stroke();
  for (const [re, im] of near) {
    context.strokeStyle = re < 0 ? colour("c0") : colour("bad");
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(x(re) - 5, y(im) - 5); context.lineTo(x(re) + 5, y(im) + 5);
    context.moveTo(x(re) + 5, y(im) - 5); context.lineTo(x(re) - 5, y(im) + 5);
    context.stroke();
  }
  canvas.setAttribute("aria-label", "Poles [1/s]: " + near.map((pole) => short(pole[0]) + (pole[1] ? (pole[1] > 0 ? " + " : " - ") + short(Math.abs(pole[1])) + " i" : "")).join(", "));
}

const REGIONS = {
  "free": ["free", "free"], "bistable": ["bistable", "both: smooth until disturbed"], "smooth or stuck": ["bistable", "smooth until it is stopped"],
  "stick-slip": ["stickslip", "stick-slip"], "swing": ["swing", "swings"], "stuck": ["stuck", "stuck"], "none": ["none", "not known"],
};

// The regions of a map up to their borders, and the borders, drawn once.
function mapPicture(map, width, height, x, y) {
  const picture = document.createElement("canvas"), scale = window.devicePixelRatio || 1;
  picture.width = Math.round(width * scale);
  picture.height = Math.round(height * scale);
  const context = picture.getContext("2d");
  context.scale(scale, scale);
  const [us, vs] = map.axes;
  context.fillStyle = colour("free");
  context.fillRect(0, 0, width, height);
  for (const [name, patch] of [["bistable", "bistable"], ["stick-slip", "stickslip"]]) {
    context.fillStyle = context.strokeStyle = colour(patch);
    context.lineWidth = 0.8;
    for (const polygon of map.areas[name]) {
      context.beginPath();
      for (const [u, v] of polygon) context.lineTo(x(u), y(v));
      context.closePath();
      context.fill();
      context.stroke();
    }
  }
  const edges = (row) => row.map((value, i) => [i ? (row[i - 1] + value) / 2 : value, i + 1 < row.length ? (value + row[i + 1]) / 2 : value]);
  const ue = edges(us), ve = edges(vs);
  for (let i = 0; i < us.length; i++) for (let j = 0; j < vs.length; j++) {
    const name = map.regions[map.where[i][j]];
    if (name === "free" || name === "bistable" || name === "stick-slip") continue;
    context.fillStyle = colour(REGIONS[name][0]);
    const px = x(ue[i][0]), py = y(ve[j][1]);
    context.fillRect(px, py, x(ue[i][1]) - px + 0.6, y(ve[j][0]) - py + 0.6);
  }
  context.strokeStyle = colour("ink");
  context.lineWidth = 2.2;
  for (const [name, dash] of [["smooth", []], ["sticking", [7, 4]]]) {
    context.setLineDash(dash);
    for (const line of joined(map.borders[name])) {
      context.beginPath();
      for (const [u, v] of line) context.lineTo(x(u), y(v));
      context.stroke();
    }
  }
  return picture;
}

// Segments that follow one another as lines, so that dashes go on.
function joined(segments) {
  const lines = [];
  for (const [begin, end] of segments) {
    const last = lines.length ? lines[lines.length - 1] : null, tip = last ? last[last.length - 1] : null;
    if (tip && tip[0] === begin[0] && tip[1] === begin[1]) last.push(end); else lines.push([begin, end]);
  }
  return lines;
}

// The map of two numbers, across and up, with both borders and the working point. Gives the function from pixels to numbers.
function drawMap(canvas, map, at, pinnedAt, ranges, names) {
  const [context, width, height] = cleared(canvas);
  const back0 = axes(context, width, height, ranges[0], ranges[1], names);
  const [x, y, back] = back0;
  if (map) {
    const [us, vs] = map.axes;
    const key = [width, height, colour("free")].join();
    if (map.pictureKey !== key) { map.picture = mapPicture(map, width, height, x, y); map.pictureKey = key; }
    context.save();
    context.beginPath();
    context.rect(x(us[0]), y(vs[vs.length - 1]), x(us[us.length - 1]) - x(us[0]), y(vs[0]) - y(vs[vs.length - 1]));
    context.clip();
    context.drawImage(map.picture, 0, 0, width, height);
    context.restore();
  }
  const mark = (point, stroke, text) => {
    const px = Math.min(Math.max(x(point[0]), 58), width - 10), py = Math.min(Math.max(y(point[1]), 8), height - 34);
    context.lineWidth = 5; context.strokeStyle = colour("paper");
    for (const [wide, line] of [[5, colour("paper")], [2.4, stroke]]) {
      context.lineWidth = wide; context.strokeStyle = line;
      context.beginPath(); context.arc(px, py, 7, 0, 2 * Math.PI); context.moveTo(px - 12, py); context.lineTo(px + 12, py); context.moveTo(px, py - 12); context.lineTo(px, py + 12); context.stroke();
    }
    if (text) { context.fillStyle = stroke; context.textAlign = "left"; context.fillText(text, px + 10, py - 9); }
  };
  if (pinnedAt) mark(pinnedAt, colour("pin"), "pinned");
  if (at) mark(at, colour("ink"), "");
  return back;
}

// Where a border crosses a value of the number that goes up: values of the one across.
function crossings(segments, along) {
  const found = [];
  for (const [[x0, y0], [x1, y1]] of segments) if ((y0 - along) * (y1 - along) <= 0 && y0 !== y1) found.push(x0 + (along - y0) / (y1 - y0) * (x1 - x0));
  return found.sort((a, b) => a - b).filter((value, i, row) => !i || Math.abs(value - row[i - 1]) > 1e-6 * Math.abs(value));
}

// --------------------------------------------------------------------------------------------------------------------------------- in motion

// Angles of all rotors and places of all blocks over the recorded times.
function motionOf(live) {
  const rotors = [], blocks = [], time = live.timeFloats;
  for (const signal of live.signals) {
    if (signal.name.endsWith(".reference") || signal.name.endsWith(".slip")) continue;
    if (signal.base === "rad/s" && rotors.length < 4) {
      const angle = new Float64Array(time.length);
      for (let i = 1; i < time.length; i++) angle[i] = angle[i - 1] + 0.5 * (signal.floats[i] + signal.floats[i - 1]) / signal.factor * (time[i] - time[i - 1]);
      rotors.push({ name: signal.name, angle, signal });
    } else if (signal.base === "m" && blocks.length < 2) blocks.push({ name: signal.name, signal });
  }
  rotors.sort((a, b) => (a.name.startsWith("top") ? -1 : 0) - (b.name.startsWith("top") ? -1 : 0));
  return { rotors, blocks };
}

function at(live, t) {
  const time = live.timeFloats;
  let low = 0, high = time.length - 1;
  while (high - low > 1) { const middle = (low + high) >> 1; if (time[middle] <= t) low = middle; else high = middle; }
  return [low, high, time[high] > time[low] ? (t - time[low]) / (time[high] - time[low]) : 0];
}

function drawMotion(canvas, live, t) {
  const [context, width, height] = cleared(canvas);
  const { rotors, blocks } = live.motion, [i, j, part] = at(live, t);
  const value = (row) => row[i] + part * (row[j] - row[i]);
  const stuck = live.sticks.some(([begin, end]) => t >= begin && t <= end);
  const room = blocks.length && rotors.length ? width / 2 : width;
  context.lineWidth = 2;
  context.textAlign = "left";
  if (rotors.length) {
    const top = 34, bottom = height - 44, middle = Math.min(room * 0.38, 150), pipe = Math.min(14, room / 14), disc = Math.min(58, room / 5);
    const angles = rotors.map((rotor) => value(rotor.angle));
    const along = (f) => { const place = f * (angles.length - 1), k = Math.min(Math.floor(place), Math.max(angles.length - 2, 0)); return angles.length > 1 ? angles[k] + (place - k) * (angles[k + 1] - angles[k]) : angles[0]; };
    if (angles.length > 1) {
      context.fillStyle = colour("band");
      context.fillRect(middle - pipe, top, 2 * pipe, bottom - top);
      context.strokeStyle = colour("c0");
      for (let k = 0; k < 3; k++) {
        context.beginPath();
        let down = false;
        for (let step = 0; step <= 160; step++) {
          const angle = along(step / 160) + k * 2 * Math.PI / 3, py = top + step / 160 * (bottom - top);
          if (Math.cos(angle) < 0) { down = false; continue; }
          const px = middle + pipe * Math.sin(angle);
          if (down) context.lineTo(px, py); else context.moveTo(px, py);
          down = true;
        }
        context.stroke();
      }
    }
    rotors.forEach((rotor, k) => {
      const py = angles.length > 1 ? top + k / (angles.length - 1) * (bottom - top) : height / 2, last = k === angles.length - 1;
      context.beginPath(); context.ellipse(middle, py, disc, disc * 0.36, 0, 0, 2 * Math.PI);
      context.fillStyle = last && stuck ? colour("bad") : colour("paper"); context.fill();
      context.strokeStyle = colour("ink"); context.stroke();
      context.beginPath(); context.moveTo(middle, py);
      context.lineTo(middle + disc * Math.sin(angles[k]), py + disc * 0.36 * Math.cos(angles[k])); context.stroke();
      context.fillStyle = colour("ink");
      context.fillText(rotor.name.replaceAll(".", " ") + "  " + short(value(rotor.signal.floats)) + " " + rotor.signal.unit, middle + disc + 10, py + 4);
      if (last && stuck) { context.fillStyle = colour("bad"); context.fillText("sticks", middle + disc + 10, py + 20); }
    });
  }
  blocks.forEach((block, k) => {
    const left = blocks.length && rotors.length ? room : 10, py = height * (k + 1) / (blocks.length + 1), size = 34;
    let low = Infinity, high = -Infinity;
    for (const each of block.signal.floats) { if (each < low) low = each; if (each > high) high = each; }
    const px = left + 70 + (high > low ? (value(block.signal.floats) - low) / (high - low) : 0.5) * (width - left - 150);
    context.strokeStyle = colour("faint");
    context.beginPath(); context.moveTo(left, py);
    for (let turn = 0; turn <= 16; turn++) context.lineTo(left + (px - left) * turn / 16, py + (turn % 2 ? 7 : -7) * (turn && turn < 16 ? 1 : 0));
    context.stroke();
    context.beginPath(); context.moveTo(left, py + size / 2 + 1); context.lineTo(width - 10, py + size / 2 + 1); context.stroke();
    context.fillStyle = stuck ? colour("bad") : colour("c0");
    context.fillRect(px, py - size / 2, size, size);
    context.fillStyle = colour("ink");
    context.fillText(block.name.replaceAll(".", " ") + "  " + short(value(block.signal.floats)) + " " + block.signal.unit + (stuck ? "  sticks" : ""), left + 4, py - size);
  });
  if (!rotors.length && !blocks.length) { context.fillStyle = colour("faint"); context.fillText("no speed or position to show", 20, 24); }
}
