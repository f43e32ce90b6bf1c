// Events on the time line, layers, and values under the pointer. Its names come from view.py: runs, plots; and from client.js.
const ASTRAY = 0.5  // m, as `turtlebot-gym evaluate` counts a robot as lost
const MOST_MARKS = 600
const hidden = new Set()
const marks = runs.map(() => ({read: 0, events: []}))

// The events in a row of a drive, from it and the row before.
function happening(data, k, sizes) {
  const events = [], before = (name) => data[name][k - 1]
  const changed = data.gx[k] !== before("gx") || data.gy[k] !== before("gy")
  const [x, y] = Number.isFinite(data.x[k]) ? [data.x[k], data.y[k]] : [data.ex[k], data.ey[k]]
  if (changed && Math.hypot(before("gx") - x, before("gy") - y) <= 2 * sizes[1]) events.push("arrival")
  if (data.clearance[k] < 0 && !(before("clearance") < 0)) events.push("contact")
  if (data.level[k] > 0 && !(before("level") >= data.level[k])) events.push("guard")
  if (data.error[k] > ASTRAY && !(before("error") > ASTRAY)) events.push("lost")
  if (data.fix[k] > 0) events.push("fix")
  return events
}

function read_events() {
  let more = false
  runs.forEach(({rows: {data}, sizes, ended}, run) => {
    const mark = marks[run], count = data.time.length
    for (let k = Math.max(mark.read, 1); k < count; k++) {
      for (const kind of happening(data, k, sizes)) mark.events.push({kind, time: data.time[k], run})
    }
    if (ended && mark.read === 0 && !mark.events.some(({kind, time}) => kind === ended && time === data.time[count - 1]))
      mark.events.push({kind: ended, time: data.time[count - 1], run})
    more ||= mark.read !== count
    mark.read = count
  })
  if (more) show_events()
}

const all_events = () => marks.flatMap(({events}) => events).sort((a, b) => a.time - b.time)

function show_events() {
  const line = element("events"), events = all_events()
  const kept = events.length > MOST_MARKS ? events.filter(({kind}) => kind !== "fix").slice(0, MOST_MARKS) : events
  line.replaceChildren(...kept.map(({kind, time, run}) => {
    const mark = document.createElement("button")
    mark.type = "button"
    mark.tabIndex = -1
    mark.className = `event ${kind}`
    mark.title = `${kind}, ${time.toFixed(1)} s${runs.length > 1 ? `, ${runs[run].label}` : ""}`
    mark.style.setProperty("--at", time / Math.max(end(), 1e-9))
    mark.addEventListener("click", () => seek(time))
    return mark
  }))
}

function seek_event(step) {
  const times = all_events().filter(({kind}) => kind !== "fix").map(({time}) => time)
  const next = step > 0 ? times.find((t) => t > time + 1e-3) : times.findLast((t) => t < time - 1e-3)
  if (next !== undefined) seek(next)
}

// Layers: each entry of the legend shows or hides what it names, in the maps and in the plots.
for (const button of document.querySelectorAll(".legend button")) {
  button.addEventListener("click", () => {
    const {layer} = button.dataset, shown = hidden.delete(layer)
    if (!shown) hidden.add(layer)
    button.setAttribute("aria-pressed", String(shown))
    for (const {curves} of plots) {
      for (const curve of curves) if (curve.layer === layer) set(curve.drawn, {visible: shown})
    }
    if (layer === "map") for (const {chart} of runs) for (const picture of chart) set(picture, {visible: shown})
    draw()
  })
}

// Plots that have nothing to show yet are left out; the last one that is shown has the axis.
const plot_elements = [...document.querySelectorAll(".plots > .plot")]
const has_data = ({curves}) => curves.some(({run, column}) => runs[run].rows.data[column].some(Number.isFinite))

function choose_plots() {
  const shown = plots.map((plot) => plot.known ||= has_data(plot)), last = shown.lastIndexOf(true)
  plots.forEach(({figure}, at) => {
    plot_elements[at].hidden = !shown[at]
    for (const axis of figure.below) if (axis.visible !== (at === last)) set(axis, {visible: at === last})
  })
}

const tip = element("tip")

function tell(event, lines) {
  tip.hidden = lines.length === 0
  if (tip.hidden) return
  tip.innerHTML = lines.map((line) => `<div>${escaped(line)}</div>`).join("")
  const right = event.clientX + 14 + tip.offsetWidth > innerWidth
  tip.style.left = `${right ? event.clientX - 14 - tip.offsetWidth : event.clientX + 14}px`
  tip.style.top = `${Math.min(Math.max(event.clientY - 10, 0), innerHeight - tip.offsetHeight)}px`
}

const quiet = (event) => tell(event, [])
const number = (value, digits = 3) => Number.isFinite(value) ? value.toFixed(digits) : "-"

// The place under the pointer, and when the robot was there.
function tell_place(event, run) {
  const [x, y] = place_in(map_views[run], event), {rows: {data}} = runs[run]
  const lines = [`x ${number(x, 2)} m, y ${number(y, 2)} m`]
  let near = 12 * camera.metres, row = -1
  for (let k = 0; k < data.time.length; k++) {
    const away = Number.isFinite(data.x[k]) ? Math.hypot(data.x[k] - x, data.y[k] - y) : Math.hypot(data.ex[k] - x, data.ey[k] - y)
    if (away < near) [near, row] = [away, k]
  }
  if (row >= 0) lines.push(`the robot, at ${number(data.time[row], 1)} s`)
  tell(event, lines)
}

function tell_values(event, {curves}, t) {
  const shown = curves.filter(({layer}) => !hidden.has(layer))
  const lines = shown.map(({run, column, label}) => {
    const {data} = runs[run].rows
    return `${label} ${number(data[column][row_at(data.time, t)])}`
  })
  tell(event, [`${number(t, 1)} s`, ...lines])
}

map_elements.forEach((map, run) => {
  map.addEventListener("pointermove", (event) => event.buttons ? quiet(event) : tell_place(event, run))
  map.addEventListener("pointerleave", quiet)
})
plot_elements.forEach((plot, at) => {
  const view = cb_context.index[plots[at].figure.id]
  const at_pointer = (event) => Math.min(Math.max(place_in(view, event)[0], 0), end())
  const scrub = (event) => { if (event.buttons === 1) seek(at_pointer(event)) }
  plot.addEventListener("pointerdown", scrub)
  plot.addEventListener("pointermove", (event) => { scrub(event); tell_values(event, plots[at], at_pointer(event)) })
  plot.addEventListener("pointerleave", quiet)
})
