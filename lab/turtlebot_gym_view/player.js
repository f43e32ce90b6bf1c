// Time is played and sought, by buttons and keys. Zooming, panning, the selection of an interval and values under the
// pointer are Bokeh's. Names come from view.py: runs, maps, layers, plots, range, cursor, theme; and from moment.js.
function show(t) {
  time = Math.min(Math.max(t, 0), end())
  runs.forEach(show_run)
  maps.forEach(tell_numbers)
  set(cursor, {location: time})
  slider.value = time
  element("clock").textContent = `${time.toFixed(1)} / ${end().toFixed(1)} s`
}

function play(on) {
  const button = element("play"), turn = playing = on ? playing + 1 || 1 : 0
  button.textContent = on ? "\u275a\u275a" : "\u25b6"
  button.setAttribute("aria-label", on ? "pause" : "play")
  if (!on) return
  if (time >= until() - 1e-6 || time < from()) show(from())
  let before = performance.now()
  requestAnimationFrame(function frame(at) {
    if (playing !== turn) return
    const t = time + Math.max(at - before, 0) * 1e-3 * Number(speed.value)
    before = at
    show(Math.min(t, until()))
    if (t >= until()) play(false)
    else requestAnimationFrame(frame)
  })
}

function seek(t) { play(false); show(t) }
const middle = ({start, end}) => [0.5 * (start + end), 0.5 * (end - start)]
function reset() {
  for (const {figure} of maps) figure.reset.emit()
}
const whole = () => set(range, {start: 0, end: Math.max(end(), 1)})

// Plots that have nothing to show are left out.
function begin() {
  const elements = document.querySelectorAll(".plot")
  const shown = plots.map(({curves}) => curves.some(({run, column}) => runs[run].rows.data[column].some(Number.isFinite)))
  plots.forEach(({figure}, at) => {
    elements[at].hidden = !shown[at]
    for (const axis of figure.below) set(axis, {visible: at === shown.lastIndexOf(true)})
  })
  whole()
  slider.max = end()
  show(time)
}

function paint() {
  const shade = matchMedia("(prefers-color-scheme: dark)").matches ? 1 : 0
  for (const [model, name, ...values] of theme) set(model, {[name]: values[shade]})
}

const step = (event) => event.shiftKey ? 1 : 0.1
const actions = {play: () => play(!playing), reset}
const keys = {
  " ": actions.play, ArrowRight: (event) => seek(time + step(event)), ArrowLeft: (event) => seek(time - step(event)),
  Home: () => seek(from()), End: () => seek(until()), r: reset,
}
document.addEventListener("keydown", (event) => {
  const act = keys[event.key] ?? keys[event.key.toLowerCase()]
  if (!act || event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select")) return
  if (event.key === " " && event.target.matches("button")) return
  event.preventDefault()
  act(event)
})
for (const [name, act] of Object.entries(actions)) element(name)?.addEventListener("click", act)
slider.addEventListener("input", () => seek(Number(slider.value)))
choice?.addEventListener("change", () => choose(Number(choice.value)))
for (const button of document.querySelectorAll(".legend button")) {
  button.addEventListener("click", () => {
    const {layer} = button.dataset, shown = hidden.delete(layer)
    if (!shown) hidden.add(layer)
    button.setAttribute("aria-pressed", String(shown))
    arrange()
  })
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", paint)
range.change.connect(() => show(time))
if (matchMedia("(pointer: coarse)").matches)  // a finger on a plot scrolls the page
  for (const {figure} of plots) for (const tool of figure.toolbar.tools) if (tool.dimensions) set(tool, {active: false})

window.watch = {
  seek, reset, whole, choose, play: () => play(true), pause: () => play(false), get time() { return time }, get end() { return end() },
  layers, trail: (run) => runs[run].moment.trail.data, get playing() { return playing > 0 }, get range() { return [range.start, range.end] },
  get camera() { return [maps[0].figure.x_range, maps[0].figure.y_range].flatMap(middle) },
}
paint()
arrange()
begin()
document.documentElement.dataset.ready = "true"
