
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const calm = matchMedia("(prefers-reduced-motion: reduce)");
const find = id => document.getElementById(id), all = (within, what) => [...within.querySelectorAll(what)];
const slider = find("time"), play = find("play"), speed = find("speed");
const HOLD = 1.5;  // seconds at the end, and at each impact where motion is to be reduced
const LIT = 0.45;  // seconds for which an impact is seen
const rate = data.span / data.seconds, DEGREES = 180 / Math.PI;
const signs = {1: "+", "-1": "−"};

const paths = ["orbit", "path"].map((key, i) => {
  const section = document.querySelector(`section.${key}`), path = data.paths[i];
  return {
    ...path, moving: all(section, ".moving"), flashes: all(section, ".flash"), words: all(section, ".hit"),
    count: section.querySelector(".count"), last: section.querySelector(".last"),
    marks: Object.fromEntries(all(document, `.mark.${key}`).map(mark => [mark.dataset.k, mark])),
  };
});
const instants = [...new Set(paths.flatMap(path => path.hits))].sort((a, b) => a - b);
const cursors = all(document, ".cursor");
let now = 0, running = false, before = null, held = 0;

function below(list, value) {  // how many entries of a sorted list are at most a value
  let low = 0, high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle] <= value) low = middle + 1; else high = middle;
  }
  return low;
}

function between(path, x) {  // a displacement, on the straight line between two recorded ones
  const i = Math.min(Math.max(below(path.t, now), 1), path.t.length - 1);
  const share = Math.min(Math.max((now - path.t[i - 1]) / (path.t[i] - path.t[i - 1]), 0), 1);
  return x[i - 1] + share * (x[i] - x[i - 1]);
}

function move(path, driver) {
  // of the driver and each wheel or body, as `drawing.places` has it, and after these the displacements
  const xs = path.x.map(x => between(path, x)), places = [driver];
  xs.forEach((x, i) => {
    const parent = data.parents[i];
    places.push(data.ratios[i] * places[parent] + (parent ? x : -x));
  });
  places.push(...xs);
  path.moving.forEach((part, i) => {
    const [place, factor, rest, change] = data.parts[i], moved = factor * places[place];
    part.setAttribute("transform", `${change}${rest + (change === "rotate(" ? moved % 360 : moved)})`);
  });
}

function flash(path) {
  const lit = LIT * rate, many = below(path.hits, now);
  path.count.textContent = `impact ${many ? path.numbers[many - 1] : 0}`;
  const code = many ? path.codes[many - 1] : 0;
  path.last.textContent = code ? `, at ${data.words[0]} ${Math.abs(code)}, ${data.words[1]} ${signs[Math.sign(code)]}` : "";
  const first = below(path.hits, now - lit), recent = [];
  for (let k = first; k < many; k++) recent.push(k);
  path.flashes.forEach((star, i) => {
    const mine = recent.filter(k => Math.abs(path.codes[k]) === i + 1).pop();
    const shown = mine !== undefined;
    star.style.visibility = path.words[i].style.visibility = shown ? "visible" : "hidden";
    if (!shown) return;
    const age = (now - path.hits[mine]) / lit, height = data.sparks[i][path.codes[mine] > 0 ? 1 : 0];
    const size = calm.matches ? 0.75 : 0.85 - 0.4 * age;
    star.setAttribute("transform", `translate(0 ${height}) scale(${size})`);
    star.dataset.impact = path.numbers[mine];
  });
  path.lit?.forEach(mark => mark.classList.remove("lit"));
  path.lit = recent.map(k => path.marks[k]);
  path.lit.forEach(mark => mark.classList.add("lit"));
}

function motion(angle) {
  return data.drive.reduce((sum, [order, amplitude, phase]) => sum + amplitude * Math.sin(order * angle + phase), 0);
}

function draw() {
  const angle = data.phase + now, driver = data.alpha * motion(angle), share = 100 * now / data.span;
  paths.forEach(path => { move(path, driver); flash(path); });
  cursors.forEach(line => { line.setAttribute("x1", `${share}%`); line.setAttribute("x2", `${share}%`); });
  const degrees = ((angle * DEGREES) % 360 + 360) % 360;
  document.querySelector(".hand").setAttribute("transform", `rotate(${degrees})`);
  find("tau").textContent = (data.offset + now).toFixed(data.digits).replace("-", "−");
  if (data.ms !== null) find("ms").textContent = ((data.offset + now) * data.ms).toPrecision(4).replace("-", "−") + " ms";
  find("phase").textContent = `${Math.floor(degrees)}°`;
  slider.value = now / data.span;
  slider.setAttribute("aria-valuetext", `τ = ${find("tau").textContent}`);
}

function go(time) { now = Math.min(Math.max(time, 0), data.span); held = 0; draw(); }

function set(on) {
  running = on;
  before = null;
  play.textContent = on ? "Pause" : "Play";
  if (on) requestAnimationFrame(step);
}

function step(moment) {
  if (!running) return;
  const passed = before === null ? 0 : Math.min((moment - before) / 1000, 0.1) * Number(speed.value);
  before = moment;
  if (calm.matches) {  // from impact to impact, without motion between them
    held += passed;
    if (held >= HOLD) go(next() ?? 0);
  } else if (now < data.span) {
    go(now + passed * rate);
  } else {
    held += passed;
    if (held >= HOLD) go(0);
  }
  requestAnimationFrame(step);
}

const next = () => instants[below(instants, now)];
const previous = () => instants[below(instants, now) - (instants[below(instants, now) - 1] === now ? 2 : 1)];

play.addEventListener("click", () => set(!running));
slider.addEventListener("input", () => { set(false); go(slider.value * data.span); });
find("next").addEventListener("click", () => { set(false); go(next() ?? data.span); });
find("back").addEventListener("click", () => { set(false); go(previous() ?? 0); });

function asked() {  // "#t=3.2" shows that time, counted from the start, and stands still
  const found = /^#t=([0-9.eE+-]+)$/.exec(location.hash);
  if (!found || !Number.isFinite(Number(found[1]))) return false;
  set(false);
  go(Number(found[1]));
  return true;
}
addEventListener("hashchange", asked);
draw();
if (!asked() && !calm.matches) set(true);
// within another page, that page is told how high this one is: how many lines the caption takes depends on the width
const told = () => parent.postMessage({ height: document.body.offsetHeight }, "*");
if (parent !== window) new ResizeObserver(told).observe(document.body);
