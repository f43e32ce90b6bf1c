// What is shown of the drives at a time: tables for Bokeh's glyphs, numbers, and layers. Names come from view.py: runs, maps,
// layers, plots, range, words, details; and from player.js.
const element = (name) => document.getElementById(name)
const slider = element("time"), speed = element("speed"), choice = element("drive")
const hidden = new Set()
let time = 0, playing = 0, selected = -1

const set = (model, values) => model.setv(values, {sync: false})
const last = ({rows}) => rows.data.time.at(-1) ?? 0
const end = () => Math.max(...runs.map(last))
const from = () => Math.max(range.start, 0)
const until = () => Math.min(range.end, end())

// The number of entries of a sorted column up to a value.
function count(column, value) {
  let low = 0, high = column.length
  while (low < high) {
    const middle = (low + high) >> 1
    if (column[middle] <= value) low = middle + 1
    else high = middle
  }
  return low
}
const row_at = (times, t) => Math.max(count(times, t + 1e-4) - 1, 0)
const LONGEST = 4000  // rows of a path that are drawn: of a longer interval every n-th
const thinned = (values, a, b, every) => values.filter((_, at) => (a + at) % every === 0 || a + at === b - 1)
const cut = (source, names, a, b) => Object.fromEntries(names.map((name) => [name, Array.prototype.slice.call(source.data[name], a, b)]))
const of_row = (source, k, names = Object.keys(source.data)) => cut(source, names, count(source.data.row, k - 1), count(source.data.row, k))

// Where the beams of the newest scan ended.
function points_of({scans: {data}, beams: {data: {range: millimetres}}}, k) {
  const x = [], y = [], at = count(data.row, k) - 1
  for (let beam = data.end[at - 1] ?? 0, first = beam; beam < data.end[at]; beam++) {
    if (millimetres[beam] === 0) continue
    const angle = data.theta[at] + data.first[at] + (beam - first) * data.increment[at]
    x.push(data.x[at] + 1e-3 * millimetres[beam] * Math.cos(angle))
    y.push(data.y[at] + 1e-3 * millimetres[beam] * Math.sin(angle))
  }
  return {x, y}
}

// The circles of a row: people if they move, else pillars.
function people_of({people, still}, k) {
  const found = of_row(people, k), circles = found.row.length ? found : {x: still.map(([x]) => x), y: still.map(([, y]) => y), radius: still.map(([,, r]) => r)}
  const sizes = (moves) => circles.radius.map((radius, at) => (circles.moves?.[at] > 0) === moves ? radius : NaN)
  return {x: circles.x, y: circles.y, pillar: sizes(false), person: sizes(true)}
}

// What many rows share is set once, since Bokeh then draws it anew.
const entries = ({data: {row}}, k) => `${count(row, k - 1)} to ${count(row, k)}`
function renew(run, name, key, of) {
  run.keys ??= {}
  if (run.keys[name] === key) return
  run.keys[name] = key
  set(run.moment[name], {data: of()})
}

function show_run(run) {
  const {rows, moment, tracks, places} = run, {data} = rows, k = row_at(data.time, time), first = Math.min(row_at(data.time, from()), k)
  const state = `${k}/${first}/${data.time.length}`
  if (run.state === state) return
  run.state = state
  const now = cut(rows, Object.keys(moment.now.data), k, k + 1)
  if (!Number.isFinite(now.x[0])) for (const name of ["x", "y", "theta"]) now[name] = now[`e${name}`]  // the truth is not known
  run.now = now
  set(moment.now, {data: now})
  const every = Math.ceil((row_at(data.time, until()) - first + 1) / LONGEST), path = cut(rows, Object.keys(moment.trail.data), first, k + 1)
  if (every > 1) for (const name in path) path[name] = thinned(path[name], first, k + 1, every)
  set(moment.trail, {data: path})
  renew(run, "people", entries(run.people, k), () => people_of(run, k))
  if (!chosen(runs.indexOf(run))) return
  renew(run, "points", count(run.scans.data.row, k), () => points_of(run, k))
  renew(run, "tracks", entries(tracks, k), () => of_row(tracks, k))
  renew(run, "places", entries(places, k), () => of_row(places, k))
}

function tell_numbers(shown, at) {
  const run = runs[shown.runs.length === 1 ? shown.runs[0] : selected], items = []
  if (run && shown.runs.includes(runs.indexOf(run))) {
    const {now, reports: {data: {row, text}}} = run, k = row_at(run.rows.data.time, time)
    const numbers = [["to the waypoint", Math.hypot(now.gx[0] - now.x[0], now.gy[0] - now.y[0]), 2, " m"]]
    for (const [name, column, ...how] of words) numbers.push([name, now[column]?.[0], ...how])
    const others = of_row(run.places, k).x.length
    numbers.push(["other places", others || NaN, 0, ""])
    for (const [name, value, digits, unit] of numbers) if (Number.isFinite(value)) items.push([name, `${value.toFixed(digits)}${unit}`])
    const report = text[count(row, k) - 1]
    if (report) items.push(["guard", report])
  }
  element(`readout${at}`).replaceChildren(...items.flatMap(([name, value]) => {
    const item = document.createElement("span")
    item.append(`${name} `, Object.assign(document.createElement("b"), {textContent: value}))
    return [item, " "]
  }))
}

const chosen = (run) => selected === run || maps[runs[run].map].runs.length === 1

// Layers: those that are hidden by the legend, those of the drives that are looked at, and those of the others, pale.
function arrange() {
  const first = (run) => maps[runs[run].map].runs[0] === run && !maps[runs[run].map].runs.includes(selected)
  for (const [run, layer, renderer] of layers) {
    const pale = selected >= 0 && !chosen(run)
    const wanted = layer === "robot" || (layer === "ghost" ? pale : layer === "truth" ? !pale : chosen(run) || !details.includes(layer) && first(run))
    set(renderer, {visible: wanted && !hidden.has(layer), muted: pale && layer === "robot"})
  }
  for (const {chart} of maps) for (const picture of chart) set(picture, {visible: !hidden.has("map")})
  for (const {curves} of plots) for (const {drawn, layer, run} of curves)
    set(drawn, {visible: !hidden.has(layer), muted: layer === "" && selected >= 0 && selected !== run})
  for (const item of document.querySelectorAll("[data-detail]")) item.hidden = !runs.some((_, run) => chosen(run))
  for (const item of document.querySelectorAll("[data-run]")) item.classList.toggle("pale", selected >= 0 && selected !== Number(item.dataset.run))
}
function choose(run) {
  selected = run
  choice.value = String(run)
  for (const each of runs) each.state = ""
  arrange()
  show(time)
}
