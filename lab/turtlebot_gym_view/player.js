// Time is played and sought, by buttons and keys. Zooming, panning, the selection of an interval and values under the
// pointer are Bokeh's. Names come from view.py: runs, maps, layers, plots, line, range, cursor, theme, edge; and from moment.js.
function show(t) {
  time = Math.min(Math.max(t, 0), end())
  runs.forEach(show_run)
  runs.forEach(tell_score)
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

// Events, where the time of one that is within a gap of a tap is meant.
const all_events = () => runs.flatMap(({events: {data}}, run) => Array.from(data.time, (time, at) => ({time, kind: data.kind[at], run})))
  .sort((a, b) => a.time - b.time)
function seek(t, gap = 0) {
  const near = all_events().map((event) => event.time).filter((at) => Math.abs(at - t) < gap)
  play(false)
  show(near.sort((a, b) => Math.abs(a - t) - Math.abs(b - t))[0] ?? t)
}
const middle = ({start, end}) => [0.5 * (start + end), 0.5 * (end - start)]
function reset() {
  for (const {figure} of maps) figure.reset.emit()
}
// Bokeh keeps the ends of a range that somebody has moved where the frame changes its shape: the scale along y is set anew.
function square() {
  const {figure: {x_range, y_range, inner_width, inner_height}} = maps[0]
  if (x_range.have_updated_interactively && inner_width > 0 && inner_height > 0)
    set(y_range, {start: middle(y_range)[0] - middle(x_range)[1] * inner_height / inner_width, end: middle(y_range)[0] + middle(x_range)[1] * inner_height / inner_width})
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
  set(line.x_range, {start: -edge * end(), end: (1 + edge) * end()})
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
for (const side of ["inner_width", "inner_height"]) maps[0].figure.properties[side].change.connect(square)
range.change.connect(() => show(time))
if (matchMedia("(pointer: coarse)").matches)  // a finger on a plot scrolls the page
  for (const {figure} of plots) for (const tool of figure.toolbar.tools) if (tool.dimensions) set(tool, {active: false})

window.watch = {
  seek, reset, whole, choose, play: () => play(true), pause: () => play(false), get time() { return time }, get end() { return end() },
  layers, trail: (run) => runs[run].moment.trail.data, get playing() { return playing > 0 }, get events() { return all_events() }, get range() { return [range.start, range.end] },
  get camera() { return [maps[0].figure.x_range, maps[0].figure.y_range].flatMap(middle) },
}
paint()
arrange()
begin()
if (!matchMedia("(prefers-reduced-motion: reduce)").matches) {
  new IntersectionObserver((entries, observer) => {
    if (!entries.some(({isIntersecting}) => isIntersecting)) return
    observer.disconnect()
    if (time > 0 || playing) return
    speed.value = [...speed.options].map(({value}) => value).findLast((value) => Number(value) <= Math.max(1, end() / 30))
    play(true)
  }).observe(element("play"))
}
document.documentElement.dataset.ready = "true"
