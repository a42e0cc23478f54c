// The page: what one turns is sent, one question at a time, so that a fast drag ends on its last value; what comes back is drawn.
"use strict";

const find = (id) => document.getElementById(id);
const page = Array.from(crypto.getRandomValues(new Uint8Array(12)), (byte) => byte.toString(16).padStart(2, "0")).join("");
const COLOURS = ["c0", "c1", "c2", "c3", "c4", "c5"];

let told = null;              // what there is: laws and their controls
let setting = null;           // what one looks at: {label, changes, disturbance}
let history = [];             // settings before, for undo
let live = null, pinned = null, map = null;
let plots = [], spectrum = null, rows = new Map();
let axesChosen = {};          // {label: [across, up]}
let asked = 0, answered = 0, running = false, gesture = "", lastPrint = "", turned = "";
let later = null;             // ends the wait for what follows a first answer
let cursorTime = null, playing = null, mapAbort = null, mapKey = "", backOfMap = null;

async function ask(question, what, signal) {
  const answer = await fetch(question, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(what), signal });
  if (!answer.ok) throw new Error(await answer.text());
  return answer;
}

function say(text, wrong = false) {
  find("said").textContent = text;
  find("said").classList.toggle("wrong", wrong);
}

const law = () => told.laws[setting.label];
const control = (name) => law().controls.find((each) => each.name === name);
const copied = (value) => JSON.parse(JSON.stringify(value));

// The value of a number in SI, as it is set, or as it was declared.
function valueOf(name) {
  const changed = setting.changes[name];
  return typeof changed === "number" ? changed : (live && live.values && typeof changed === "string" ? live.values[name] : law().values[name]);
}

// --------------------------------------------------------------------------------------------------------------------------------- changes

// One gesture, however many values it has, is one step of undo.
function begin(name) {
  const now = performance.now();
  if (gesture === name && now - begin.last < 900) { begin.last = now; return; }
  gesture = name;
  begin.last = now;
  history.push(copied(setting));
  if (history.length > 200) history.shift();
}
begin.last = 0;

function change(name, value) {
  begin(name);
  if (value === undefined) delete setting.changes[name]; else setting.changes[name] = value;
  turned = name;
  staleMap();
  changed();
}

function changed() {
  asked += 1;
  if (later) later.abort();
  find("undo").disabled = !history.length;
  find("reset").disabled = !Object.keys(setting.changes).length && !setting.disturbance;
  for (const kind of ["rock", "bump"]) find(kind).setAttribute("aria-pressed", String(setting.disturbance === kind));
  for (const row of rows.values()) row.show();
  drawMapNow();
  document.body.classList.add("busy");
  run();
}

async function run() {
  if (running) return;
  running = true;
  while (answered !== asked) {
    const mine = asked, sent = copied(setting);
    try {
      let found = await (await ask("run", { setting: sent, page, soon: true })).json();
      if (found.error) { refused(found.error, mine); continue; }
      if (found.waiting) { if (mine !== asked) { answered = mine; continue; } } else receive(found, sent, mine);
      if (!(found.whole && found.decided) && mine === asked) {
        if (!found.whole) say(found.waiting || "The run is shown as far as it is, " + short(found.end) + " s; the rest follows.");
        later = new AbortController();
        found = await (await ask("run", { setting: sent, page }, later.signal)).json();
        if (mine === asked) { if (found.error) refused(found.error, mine); else receive(found, sent, mine, true); }
      }
    } catch (failure) {
      if (failure.name !== "AbortError") refused("The page has ended: " + failure.message, mine);
    }
    later = null;
  }
  running = false;
  document.body.classList.remove("busy");
  follow();
}

function refused(text, mine) {
  answered = mine;
  say(text, true);
  document.body.dataset.painted = String(mine);
}

function receive(found, sent, mine, again = false) {
  answered = mine;
  found.timeFloats = floats(found.time);
  found.stuckFloats = floats(found.stuck);
  for (const signal of [...found.signals, ...found.plane]) signal.floats = floats(signal.values);
  found.motion = motionOf(found);
  found.values = live ? live.values : null;
  found.setting = sent;
  const whole = live && live.whole;
  const same = live && live.print === found.print && turned && live.setting.label === sent.label;
  live = found;
  const lacking = found.lacking.length ? " This law has no " + found.lacking.join(", ") + "." : "";
  const row = rows.get(turned);
  if (again) {
    if (!whole) say(lacking.trim());
  } else if (same && sent.changes[turned] !== undefined) {
    say("Turning " + turned + " does not change this run: nothing that happens in it depends on this number here." + lacking);
    if (row) row.note("No effect on this run: nothing that happens in it depends on this number here.");
  } else {
    if (row) row.note("");
    say(lacking.trim());
  }
  turned = "";
  show();
  requestAnimationFrame(() => requestAnimationFrame(() => {
    document.body.dataset.print = found.print;
    document.body.dataset.decided = found.decided ? String(mine) : "";
    if (mine > Number(document.body.dataset.painted || 0)) document.body.dataset.painted = String(mine);  // what came later may have been refused meanwhile
  }));
}

let following = 0;
function follow() {
  clearTimeout(following);
  following = setTimeout(async () => {
    if (running || answered !== asked) return;  // what follows is that of the run that is shown; it is asked for when the one under way has come
    const mine = asked;
    askMap();
    try {
      const found = await (await ask("further", { setting: live.setting, page })).json();
      if (mine !== asked || found.error || found.cancelled) return;
      live.values = found.values;
      live.without = found.without;
      live.poles = found.poles;
      find("drive").hidden = !found.drive.length;
      find("drive-words").replaceChildren(...found.drive.map((words) => { const line = document.createElement("li"); line.textContent = words; return line; }));
      drawPoles(find("poles"), found.poles);
      find("poles-words").textContent = found.poles_words.replaceAll("`", "");
      find("cost").textContent = "Simulated in " + short(live.milliseconds) + " ms" + (found.inexact === undefined ? "; its error could not be measured: " + found.error_words : "; measured error " + short(found.inexact) + ", in parts of the size of each state") + ". Server: this computer alone.";
      for (const row of rows.values()) row.show();
      document.body.dataset.followed = String(mine);
    } catch (failure) { /* the page says it when a number is turned */ }
  }, 300);
}

// --------------------------------------------------------------------------------------------------------------------------------- numbers

function addNumber(each, box) {
  const id = "n-" + each.name.replace(/[^A-Za-z0-9]/g, "-");
  const row = document.createElement("div");
  row.className = "number";
  const top = document.createElement("div"), label = document.createElement("label"), box2 = document.createElement("input");
  const unit = document.createElement("span"), back = document.createElement("button"), slider = document.createElement("input"), small = document.createElement("small"), why = document.createElement("small");
  top.className = "top";
  label.htmlFor = id;
  label.textContent = each.name;
  const spoken = each.name + (each.meaning ? ", " + each.meaning : "") + (each.unit === "1" ? "" : ", in " + each.unit);
  Object.assign(box2, { id, type: "text", inputMode: "decimal", autocomplete: "off", spellcheck: false });
  box2.setAttribute("aria-label", spoken);
  unit.className = "unit";
  unit.textContent = each.unit === "1" ? "" : each.unit;
  back.className = "back";
  back.textContent = "↺";
  back.title = "as declared";
  back.setAttribute("aria-label", each.name + " as declared");
  Object.assign(slider, { type: "range", min: each.low, max: each.high, step: each.step });
  slider.setAttribute("aria-label", spoken + ", slider");
  small.textContent = [each.meaning, each.kind === "start" ? "value at the start" : "", each.kind === "sample time" || each.kind === "delay" ? each.kind : "", each.bounds].filter(Boolean).join("; ");
  why.className = "why";
  why.id = id + "-why";
  box2.setAttribute("aria-describedby", why.id);
  top.append(label, box2, unit, back);
  row.append(top, slider, small, why);
  box.append(row);
  const shown = (value) => Number((value * each.factor).toPrecision(6));
  let noted = "";
  const self = {
    note(text) { noted = text; self.show(); },
    show() {
      const value = valueOf(each.name), is = setting.changes[each.name] !== undefined;
      const without = live && live.without && live.setting.label === setting.label ? live.without[each.name] : law().without[each.name];
      row.classList.toggle("changed", is);
      row.classList.toggle("without", Boolean(without));
      back.hidden = !is;
      slider.disabled = Boolean(without) && !is;
      const moving = law().moving.includes(each.name) && !is;
      why.textContent = without || noted || (moving ? "Varies in time in this scene; turned, it is held constant." : "");
      if (typeof value === "number" && isFinite(value)) {
        const number = shown(value);
        if (number < Number(slider.min)) slider.min = number;
        if (number > Number(slider.max)) slider.max = number;
        if (document.activeElement !== slider) slider.value = number;
        slider.setAttribute("aria-valuetext", number + " " + (each.unit === "1" ? "" : each.unit));
        if (document.activeElement !== box2) box2.value = String(number);
      }
    },
  };
  slider.addEventListener("input", () => { change(each.name, Number(slider.value) / each.factor); });
  box2.addEventListener("change", () => {
    const text = box2.value.trim();
    const number = Number(text);
    change(each.name, text === "" ? undefined : Number.isFinite(number) ? number / each.factor : text);
  });
  back.addEventListener("click", () => { noted = ""; change(each.name, undefined); });
  rows.set(each.name, self);
  self.show();
}

function showNumbers() {
  rows.clear();
  find("first").replaceChildren();
  for (const each of law().controls) if (each.first) addNumber(each, find("first"));
  search();
}

function search() {
  const words = find("search").value.toLowerCase().split(/\s+/).filter(Boolean), box = find("others");
  for (const each of law().controls) if (!each.first) rows.delete(each.name);
  box.replaceChildren();
  const rest = law().controls.filter((each) => !each.first);
  const found = rest.filter((each) => setting.changes[each.name] !== undefined || (words.length && words.every((word) => (each.name + " " + each.meaning + " " + each.kind + " " + each.unit).toLowerCase().includes(word))));
  for (const each of found.slice(0, 40)) addNumber(each, box);
  find("count").textContent = words.length ? found.length + " of " + rest.length + (found.length > 40 ? ", the first 40" : "") : rest.length + " more: " + [...new Set(rest.map((each) => each.part))].join(", ");
}

// --------------------------------------------------------------------------------------------------------------------------------- what is shown

function show() {
  const box = find("answer");
  box.classList.remove("good", "fair", "bad");
  box.classList.add(live.tone);
  find("word").textContent = live.verdict;
  find("reason").textContent = live.reason.replaceAll("`", "");
  find("stuck-name").textContent = live.element || "the contact";
  const list = find("measures");
  list.replaceChildren();
  for (const [what, number] of live.measures) {
    const both = document.createElement("div"), name = document.createElement("dt"), value = document.createElement("dd");
    name.textContent = what;
    value.textContent = number;
    both.append(name, value);
    list.append(both);
  }
  find("pinned").hidden = !pinned;
  if (pinned) find("pinned").textContent = "Pinned (" + pinned.words + "): " + pinned.verdict + ". " + pinned.measures.map(([what, number]) => what + " " + number).join(", ");
  drawTraces();
  drawPlane(find("plane"), live, pinned);
  drawSpectrum();
  if (cursorTime === null || cursorTime > live.end) cursorTime = live.end;
  showMotion();
  drawMapNow();
}

function panelsOf(found) {
  const groups = new Map();
  for (const signal of found.signals) {
    if (!groups.has(signal.unit)) groups.set(signal.unit, []);
    groups.get(signal.unit).push(signal);
  }
  return [...groups.values()];
}

function looks() {
  return { stroke: colour("ink"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), width: 1 } };
}

function drawTraces() {
  const groups = panelsOf(live);
  const layout = JSON.stringify(groups.map((group) => group.map((signal) => [signal.name, signal.unit])));
  if (drawTraces.layout !== layout) {
    plots.forEach((plot) => plot.destroy());
    find("panels").replaceChildren();
    plots = groups.map((group, k) => tracePanel(group, k));
    drawTraces.layout = layout;
  }
  plots.forEach((plot, k) => {
    plot.group = groups[k];
    plot.setData([live.timeFloats, ...groups[k].map((signal) => signal.floats)], plot.zoomed !== true);
    if (plot.zoomed) { plot.redraw(); if (!k) closer(); }
    plot.root.setAttribute("role", "img");
    plot.root.setAttribute("aria-label", groups[k].map((signal) => { const [low, high] = extent(signal.floats); return named(signal) + " from " + short(low) + " to " + short(high); }).join("; "));
  });
}

function tracePanel(group, k) {
  const box = find("panels");
  const options = {
    width: box.clientWidth, height: k ? 150 : 210, cursor: { sync: { key: "time" }, drag: { x: true, y: false }, bind: { dblclick: () => () => { whole(); return null; } } },
    scales: { x: { time: false }, y: { range: (plot, low, high) => {
      const ends = pinned ? pinned.signals.filter((each) => plot.group && plot.group.some((signal) => signal.name === each.name)).map((each) => extent(each.floats)) : [];
      const all = [low, high, ...ends.flat()].filter((value) => value !== null && isFinite(value));
      if (!all.length) return [0, 1];
      let least = Math.min(...all), most = Math.max(...all);
      const reach = 0.8 * (most - least);
      for (const signal of plot.group || group) for (const end of signal.limits) if (end !== null && end >= least - reach && end <= most + reach) { least = Math.min(least, end); most = Math.max(most, end); }
      const room = (most - least) * 0.06 || Math.abs(most) * 0.1 || 1;
      return [least - room, most + room];
    } } },
    series: [{ label: "time [s]", value: (_, value) => value === null ? "-" : value.toFixed(2) }, ...group.map((signal, i) => ({
      label: named(signal), stroke: () => colour(COLOURS[(i + (k ? 1 : 0)) % COLOURS.length]), width: 1.6, dash: i > 1 ? [6, 3] : i ? [10, 2] : undefined, points: { show: false }, value: (_, value) => value === null ? "-" : short(value),
    }))],
    axes: [looks(), { ...looks(), size: 64, label: group.length === 1 && named(group[0]).length < (k ? 16 : 22) ? named(group[0]) : "[" + group[0].unit + "]", labelSize: 18, values: (_, values) => told_apart(values) }],
    hooks: {
      drawClear: [(plot) => {
        const context = plot.ctx;
        context.save();
        context.beginPath();
        context.rect(plot.bbox.left, plot.bbox.top, plot.bbox.width, plot.bbox.height);
        context.clip();
        context.fillStyle = colour("band");
        for (const [begin, end] of live.sticks) {
          const left = plot.valToPos(begin, "x", true), right = plot.valToPos(end, "x", true);
          context.fillRect(left, plot.bbox.top, Math.max(right - left, 1), plot.bbox.height);
        }
        context.restore();
      }],
      draw: [(plot) => {
        const context = plot.ctx;
        context.save();
        context.beginPath();
        context.rect(plot.bbox.left, plot.bbox.top, plot.bbox.width, plot.bbox.height);
        context.clip();
        context.lineWidth = 1.5 * devicePixelRatio;
        for (const signal of plot.group || []) {
          for (const end of signal.limits) if (end !== null) {
            const y = plot.valToPos(end, "y", true);
            context.setLineDash([2 * devicePixelRatio, 3 * devicePixelRatio]);
            context.strokeStyle = colour("bad");
            context.beginPath(); context.moveTo(plot.bbox.left, y); context.lineTo(plot.bbox.left + plot.bbox.width, y); context.stroke();
          }
          const other = pinned && pinned.signals.find((each) => each.name === signal.name && each.unit === signal.unit);
          if (other) {
            context.setLineDash([5 * devicePixelRatio, 3 * devicePixelRatio]);
            context.strokeStyle = colour("pin");
            context.beginPath();
            for (let i = 0; i < other.floats.length; i++) context.lineTo(plot.valToPos(pinned.timeFloats[i], "x", true), plot.valToPos(other.floats[i], "y", true));
            context.stroke();
          }
        }
        context.setLineDash([]);
        context.lineWidth = devicePixelRatio;
        context.strokeStyle = colour("ink");
        const after = plot.valToPos(live.after, "x", true);
        context.globalAlpha = 0.5;
        context.beginPath(); context.moveTo(after, plot.bbox.top); context.lineTo(after, plot.bbox.top + plot.bbox.height); context.stroke();
        context.restore();
      }],
      setCursor: [(plot) => { if (plot.cursor.left >= 0 && !playing) { cursorTime = plot.posToVal(plot.cursor.left, "x"); showMotion(); } }],
      setScale: [(plot, key) => {
        if (key !== "x" || tracePanel.syncing) return;
        const { min, max } = plot.scales.x, whole = live && min <= live.timeFloats[0] + 1e-6 && max >= live.timeFloats[live.timeFloats.length - 1] - 1e-6;
        tracePanel.syncing = true;
        for (const other of plots) { other.zoomed = !whole; if (other !== plot && min !== null) other.setScale("x", { min, max }); }
        tracePanel.syncing = false;
        if (!whole && live && !running) closer();
      }],
    },
  };
  const plot = new uPlot(options, [live.timeFloats, ...group.map((signal) => signal.floats)], box);
  plot.group = group;
  return plot;
}

// The whole run again, whose points take the place of those of the window.
function whole() {
  tracePanel.syncing = true;
  for (const plot of plots) {
    plot.zoomed = false;
    plot.setData([live.timeFloats, ...plot.group.map((signal) => live.signals.find((each) => each.name === signal.name).floats)], true);
  }
  tracePanel.syncing = false;
}

// Traces of the window that one looks at closer, with as many points as the whole run had.
let closing = 0;
function closer() {
  clearTimeout(closing);
  closing = setTimeout(async () => {
    const mine = asked, run = live, { min, max } = plots[0].scales.x;
    try {
      const found = await (await ask("traces", { setting: run.setting, begin: min, end: max })).json();
      if (mine !== asked || run !== live || found.error || !plots[0].zoomed) return;
      const time = floats(found.time);
      for (const plot of plots) plot.setData([time, ...plot.group.map((signal) => floats(found.values[signal.name]))], false);
      for (const plot of plots) plot.redraw();
    } catch (failure) { /* the whole run is there */ }
  }, 120);
}

function drawSpectrum() {
  if (!live.spectrum) return;
  const box = find("spectrum"), data = [floats(live.spectrum.frequency), floats(live.spectrum.amplitude)];
  find("spectrum-name").textContent = "of " + live.spectrum.signal.replaceAll(".", " ") + " " + live.spectrum.when + ", amplitude [" + live.spectrum.unit + "]" + (live.spectrum.tone === null ? "" : "; loudest at " + short(live.spectrum.tone) + " Hz");
  if (!spectrum || spectrum.unit !== live.spectrum.unit) {
    if (spectrum) spectrum.destroy();
    box.replaceChildren();
    spectrum = new uPlot({
      width: box.clientWidth, height: 240, scales: { x: { time: false } }, cursor: { drag: { x: false, y: false } },
      series: [{ label: "Hz", value: (_, value) => value === null ? "-" : short(value) }, { label: "amplitude", stroke: () => colour("c0"), width: 1.5, points: { show: false }, value: (_, value) => value === null ? "-" : short(value) }],
      axes: [{ ...looks(), label: "frequency [Hz]", labelSize: 18 }, { ...looks(), size: 64, values: (_, values) => told_apart(values) }],
    }, data, box);
    spectrum.unit = live.spectrum.unit;
    spectrum.root.setAttribute("role", "img");
  } else spectrum.setData(data);
  let best = 0;
  data[1].forEach((value, i) => { if (value > data[1][best]) best = i; });
  spectrum.root.setAttribute("aria-label", "Spectrum: strongest at " + short(data[0][best]) + " Hz with " + short(data[1][best]) + " " + live.spectrum.unit);
}

function showMotion() {
  if (!live) return;
  drawMotion(find("motion"), live, cursorTime);
  find("clock").textContent = "at " + cursorTime.toFixed(2) + " s";
  find("time").max = live.end;
  find("time").step = live.end / 1000;
  if (document.activeElement !== find("time")) find("time").value = cursorTime;
}

function play() {
  const button = find("play");
  if (!live) return;
  if (playing) { cancelAnimationFrame(playing); playing = null; button.setAttribute("aria-pressed", "false"); button.textContent = "Play"; return; }
  button.setAttribute("aria-pressed", "true");
  button.textContent = "Stop";
  if (cursorTime >= live.end * 0.999) cursorTime = live.after;
  const rate = Math.min(1, live.end / 20);  // what is over in a second is shown slowly
  let before = performance.now();
  const frame = (now) => {
    playing = requestAnimationFrame(frame);
    cursorTime += (now - before) / 1000 * rate;
    before = now;
    if (!live) return;
    if (cursorTime > live.end) cursorTime = live.after;
    showMotion();
    if (plots[0]) plots.forEach((plot) => plot.setCursor({ left: plot.valToPos(cursorTime, "x"), top: 10 }, false));
  };
  playing = requestAnimationFrame(frame);
}

// --------------------------------------------------------------------------------------------------------------------------------- map

const chosenAxes = () => axesChosen[setting.label] || law().axes;

function mapRanges() {
  if (map && map.axes) return map.axes.map((axis) => [axis[0], axis[axis.length - 1]]);
  return chosenAxes().map((name) => [control(name).low, control(name).high]);
}

function drawMapNow() {
  const names = chosenAxes();
  find("map").hidden = find("axis-x").closest(".line").hidden = names.length < 2;
  if (names.length < 2) { find("map-words").textContent = law().still ? "What comes to a standstill has no steady running to map: a law that holds its speed has, such as HeldSpeed (stickslip explore --law HeldSpeed, or stickslip map --law)." : "This loop has no two numbers for a map."; return; }
  const place = (values) => names.map((name) => values(name) * control(name).factor);
  const here = place(valueOf), there = pinned && pinned.setting.label === setting.label ? place((name) => pinned.setting.changes[name] ?? law().values[name]) : null;
  backOfMap = drawMap(find("map"), map && map.axes ? map : null, here, there, mapRanges(), names.map((name) => named({ name, unit: control(name).unit })));
  if (map && map.axes) {
    const words = [["smooth", "smooth running is lost"], ["sticking", "stick-slip, once there, ends"]].map(([name, what]) => {
      const found = met(name, here, 0);
      return what + (found.length ? " at " + found.map(short).join(", ") + " " + map.units[0] : ": no border here");
    });
    find("map-words").textContent = "With " + names[1] + " at " + short(here[1]) + " " + map.units[1] + ": " + words.join("; ") + ". " + map.notes.join(" ");
    find("where").textContent = [advice(here, names, 0), advice(here, names, 1)].filter(Boolean).join(" ");
  } else { find("where").textContent = ""; if (!map || !map.error) find("map-words").textContent = "The map is being computed."; }
}

// Where a border is met along one of both numbers, 0 that goes across and 1 that goes up, while the other stays.
const met = (name, here, along) => along ? crossings(map.borders[name].map((segment) => segment.map(([x, y]) => [y, x])), here[0]) : crossings(map.borders[name], here[1]);

// What to do, in a sentence, from the nearest border of stick-slip along one of both numbers: it ends above it, or below it.
function advice(here, names, along) {
  const ends = met("sticking", here, along), unit = map.units[along] === "1" ? "" : " " + map.units[along], about = "about ";  // a map knows its borders to a part of a cell
  if (!ends.length) return "";
  const end = ends[nearest(ends, here[along])], column = map.axes[along], j = nearest(map.axes[1 - along], here[1 - along]);
  const free = (i) => map.regions[along ? map.where[j][i] : map.where[i][j]] === "free";
  let over = column.findIndex((value) => value > end), under = over - 1;
  if (over < 1) return "";
  while (under > 0 && over < column.length - 1 && free(under) === free(over)) { under -= 1; over += 1; }  // the row of points is beside this value
  if (free(under) === free(over)) return "";
  const above = free(over), inside = above ? here[along] > end : here[along] < end, away = short(Math.abs(here[along] - end)) + unit;
  if (inside) return (along && met("sticking", here, 0).length ? "At this " + names[0] + " it lasts " : "Here stick-slip dies out: it lasts ") + (above ? "below " : "above ") + names[along] + " " + about + short(end) + unit + ", " + away + " from here.";
  return (above ? "Raise " : "Lower ") + names[along] + (above ? " above " : " below ") + about + short(end) + unit + " and stick-slip ends, at this " + names[1 - along] + ".";
}

const nearest = (row, value) => row.reduce((best, each, i) => Math.abs(each - value) < Math.abs(row[best] - value) ? i : best, 0);

async function askMap() {
  const names = chosenAxes();
  if (names.length < 2) return;
  const others = Object.fromEntries(Object.entries(setting.changes).filter(([name]) => !names.includes(name)));
  const key = JSON.stringify([setting.label, names, others]);
  if (key === mapKey) return;
  mapKey = key;
  if (mapAbort) mapAbort.abort();
  mapAbort = new AbortController();
  const mine = mapAbort;
  map = null;
  drawMapNow();
  find("stage").textContent = "...";
  try {
    const answer = await ask("map", { setting: { label: setting.label, changes: others }, axes: names, page }, mine.signal);
    if (answer.headers.get("Content-Type") === "application/json") { noMap((await answer.json()).error); return; }
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    let text = "";
    for (;;) {
      const { value, done } = await reader.read();
      if (done || mine !== mapAbort) return;
      text += value;
      const lines = text.split("\n");
      text = lines.pop();
      for (const line of lines) {
        const found = JSON.parse(line);
        if (found.error) { noMap(found.error); return; }
        map = found;
        find("stage").textContent = found.points + " x " + found.points + (found.last ? "" : ", finer soon");
        document.body.dataset.map = String(found.points);
        legend();
        drawMapNow();
      }
    }
  } catch (failure) { if (failure.name !== "AbortError") noMap(failure.message); }
}

function noMap(text) {
  map = { error: text };
  find("stage").textContent = "";
  find("map-words").textContent = "No map: " + text.replaceAll("`", "");
}

// What is stale is not worked on while somebody drags.
function staleMap() {
  const names = chosenAxes();
  const others = Object.fromEntries(Object.entries(setting.changes).filter(([name]) => !names.includes(name)));
  if (mapAbort && JSON.stringify([setting.label, names, others]) !== mapKey) {
    mapAbort.abort();
    mapAbort = null;
    mapKey = "";
    ask("leave", { page }).catch(() => {});
  }
}

function legend() {
  const box = find("legend");
  box.replaceChildren();
  const there = new Set(map.where.flat().map((k) => map.regions[k]));
  for (const [name, [patch, words]] of Object.entries(REGIONS)) if (there.has(name)) {
    const entry = document.createElement("span");
    entry.style.setProperty("--patch", "var(--" + patch + ")");
    entry.textContent = words;
    box.append(entry);
  }
  for (const [dash, words] of [["solid", "smooth running is lost"], ["dashed", "stick-slip ends"]]) {
    const entry = document.createElement("span");
    entry.className = "border";
    entry.style.setProperty("--dash", dash);
    entry.textContent = words;
    box.append(entry);
  }
}

function go(x, y) {
  const names = chosenAxes();
  history.push(copied(setting));
  gesture = "";
  [x, y].forEach((value, i) => {
    const each = control(names[i]), step = each.step / 10, clipped = Math.min(Math.max(value, each.low), each.high);
    setting.changes[names[i]] = Number((Math.round(clipped / step) * step).toPrecision(9)) / each.factor;
  });
  turned = "";
  changed();
}

// --------------------------------------------------------------------------------------------------------------------------------- controls

function chooseLaw() {
  find("law").value = setting.label;
  const able = law().able, names = chosenAxes();
  ["axis-x", "axis-y"].forEach((id, i) => {
    find(id).replaceChildren(...able.map((name) => new Option(name, name, false, name === names[i])));
    find(id).value = names[i] ?? "";
  });
  for (const kind of ["rock", "bump"]) {
    const each = law().disturbances[kind];
    find(kind).disabled = !each.names.length;
    find(kind).title = each.names.length ? each.names.join(" and ") + " half as large again for a moment (2 s at most)" : each.why;
  }
  if (law().disturbances.bump.names.length) find("bump").textContent = "Bump of " + law().disturbances.bump.names[0];
  live = null;
  map = null;
  mapKey = "";
  showNumbers();
}

function setTo(other) {
  const label = setting ? setting.label : "";
  setting = copied(other);
  gesture = turned = "";
  if (label !== setting.label) chooseLaw(); else search();
  staleMap();
  changed();
}

function download(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const wordsOf = (each) => [each.label, ...Object.entries(each.changes).map(([name, value]) => {
  const known = control(name);
  return name + " " + (known && typeof value === "number" ? short(value * known.factor) + " " + (known.unit === "1" ? "" : known.unit) : value);
}), each.disturbance].filter(Boolean).join(", ");

async function keep(question, done) {
  try {
    const answer = await ask(question, { setting });
    if (answer.headers.get("Content-Type") === "application/json") {
      const found = await answer.json();
      if (found.error) { say(found.error, true); return; }
      await done(found.text);
    } else await done(await answer.blob());
  } catch (failure) { say("Not done: " + failure.message, true); }
}

function listen() {
  find("law").addEventListener("change", () => { history.push(copied(setting)); setTo({ ...setting, label: find("law").value }); });
  find("search").addEventListener("input", search);
  find("undo").addEventListener("click", () => { if (history.length) setTo(history.pop()); find("undo").disabled = !history.length; });
  find("reset").addEventListener("click", () => { history.push(copied(setting)); setTo({ label: setting.label, changes: {}, disturbance: "" }); });
  find("pin").addEventListener("click", () => {
    if (!live) return;
    pinned = pinned ? null : { ...live, words: wordsOf(live.setting) };
    find("pin").setAttribute("aria-pressed", String(Boolean(pinned)));
    find("pin").textContent = pinned ? "Unpin" : "Pin";
    show();
  });
  for (const kind of ["rock", "bump"]) find(kind).addEventListener("click", () => { history.push(copied(setting)); gesture = ""; setting.disturbance = setting.disturbance === kind ? "" : kind; turned = ""; changed(); });
  find("save-scene").addEventListener("click", () => keep("save_scene", (text) => { download("scene.toml", new Blob([text], { type: "application/toml" })); say("The scene is in the downloads: scene.toml."); }));
  find("save-run").addEventListener("click", () => keep("save_run", (blob) => { download("run.npz", blob); say("The run is in the downloads: run.npz."); }));
  find("copy").addEventListener("click", () => keep("python", async (text) => {
    try { await navigator.clipboard.writeText(text); say("Copied: " + text.split("\n").filter(Boolean).slice(1).join("; ")); } catch (failure) { say(text); }
  }));
  find("play").addEventListener("click", play);
  find("time").addEventListener("input", () => { cursorTime = Number(find("time").value); showMotion(); });
  for (const id of ["axis-x", "axis-y"]) find(id).addEventListener("change", () => {
    const names = [find("axis-x").value, find("axis-y").value];
    if (names[0] === names[1]) {  // they change places
      const other = id === "axis-x" ? 1 : 0;
      find(other ? "axis-y" : "axis-x").value = names[other] = chosenAxes()[1 - other];
    }
    axesChosen[setting.label] = names;
    map = null;
    drawMapNow();
    askMap();
  });
  const canvas = find("map");
  canvas.addEventListener("click", (event) => { if (backOfMap) go(...backOfMap(event.offsetX, event.offsetY)); });
  canvas.addEventListener("keydown", (event) => {
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }, move = moves[event.key];
    if (!move) return;
    event.preventDefault();
    const names = chosenAxes(), ranges = mapRanges();
    go(...names.map((name, i) => valueOf(name) * control(name).factor + move[i] * (ranges[i][1] - ranges[i][0]) / 40));
  });
  document.addEventListener("keydown", (event) => {
    if ((event.ctrlKey || event.metaKey) && event.key === "z" && !/^(text|search)$/.test(event.target.type || "")) { event.preventDefault(); find("undo").click(); }
  });
  new ResizeObserver(() => { if (live) { for (const plot of plots) plot.setSize({ width: find("panels").clientWidth, height: plot.height }); if (spectrum) spectrum.setSize({ width: find("spectrum").clientWidth, height: 240 }); show(); if (live.poles) drawPoles(find("poles"), live.poles); } }).observe(find("panels"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { drawTraces.layout = ""; if (spectrum) { spectrum.destroy(); spectrum = null; } if (live) { show(); if (live.poles) drawPoles(find("poles"), live.poles); } });
  addEventListener("pagehide", () => navigator.sendBeacon("leave", JSON.stringify({ page, gone: true })));
}

async function start() {
  try {
    told = await (await ask("scene", {})).json();
  } catch (failure) { say("The page cannot reach its server: " + failure.message, true); return; }
  if (told.error) { say(told.error, true); return; }
  find("title").textContent = told.title;
  document.title = told.title + " - stickslip explore";
  const labels = Object.keys(told.laws);
  find("law").replaceChildren(...labels.map((label) => new Option(label, label)));
  setting = { label: labels[0], changes: {}, disturbance: "" };
  listen();
  chooseLaw();
  changed();
}

start();
