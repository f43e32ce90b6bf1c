// Time is played and sought, by buttons and keys. Zooming, panning, the selection of an interval and values under the
// pointer are Bokeh's. Names come from view.py: runs, maps, layers, plots, line, range, cursor, theme, edge; and from moment.js.
function show(t) {
  time = Math.min(Math.max(t, 0), end())
  runs.forEach(show_run)
  runs.forEach(tell_score)
  maps.forEach(tell_numbers)
  set(cursor, {location: time})
  keep_up()
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
    show(t < until() ? t : looping ? from() : until())
    if (t >= until() && !looping) play(false)
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
function seek_event(step) {
  const times = all_events().filter(({kind}) => kind !== "fix").map((event) => event.time)
  const next = step > 0 ? times.find((t) => t > time + 1e-3) : times.findLast((t) => t < time - 1e-3)
  if (next !== undefined) seek(next)
}

// The maps: Bokeh fits them until somebody moves them, and then they hold.
function hold([x, x_half], [y, y_half]) {
  for (const {figure: {x_range, y_range}} of maps) {
    x_range.have_updated_interactively = y_range.have_updated_interactively = true
    set(x_range, {start: x - x_half, end: x + x_half})
    set(y_range, {start: y - y_half, end: y + y_half})
  }
}
const middle = ({start, end}) => [0.5 * (start + end), 0.5 * (end - start)]
function zoom(factor) {
  const [x, y] = [maps[0].figure.x_range, maps[0].figure.y_range].map(middle)
  hold([x[0], x[1] * factor], [y[0], y[1] * factor])
}
function follow(run) {
  followed = run
  pressed("follow", run >= 0)
  if (run >= 0 && !maps[0].figure.x_range.have_updated_interactively) zoom(0.5)
  keep_up()
}
function keep_up() {
  if (followed < 0) return
  const {x: [x], y: [y]} = runs[followed].now, {figure: {x_range, y_range}} = maps[0]
  if (Number.isFinite(x + y)) hold([x, middle(x_range)[1]], [y, middle(y_range)[1]])
}
function reset() {
  follow(-1)
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

const loop = (on) => { looping = on; pressed("loop", on) }
const step = (event) => event.shiftKey ? 1 : 0.1
const actions = {
  play: () => play(!playing), loop: () => loop(!looping), reset,
  follow: () => follow(followed + 1 < runs.length ? followed + 1 : -1),
  link: () => {
    history.replaceState(null, "", `#t=${time.toFixed(1)}`)
    navigator.clipboard?.writeText(location.href).catch(() => {})
  },
}
const keys = {
  " ": actions.play, ArrowRight: (event) => seek(time + step(event)), ArrowLeft: (event) => seek(time - step(event)),
  Home: () => seek(from()), End: () => seek(until()), l: actions.loop, n: () => seek_event(1), p: () => seek_event(-1), f: actions.follow,
  d: () => choice && choose(selected + 1 < runs.length ? selected + 1 : -1), r: reset, "+": () => zoom(1 / 1.2), "-": () => zoom(1.2),
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

// A link to a moment, #t=12.3; without one, what is seen begins to move.
const linked = () => /^#t=([0-9.]+)$/.exec(location.hash)
addEventListener("hashchange", () => { if (linked()) seek(Number(linked()[1])) })
window.watch = {
  seek, reset, whole, choose, play: () => play(true), pause: () => play(false), get time() { return time }, get end() { return end() },
  layers, trail: (run) => runs[run].moment.trail.data, get playing() { return playing > 0 }, get events() { return all_events() }, get range() { return [range.start, range.end] },
  get camera() { return [maps[0].figure.x_range, maps[0].figure.y_range].flatMap(middle) },
}
paint()
arrange()
begin()
if (linked()) seek(Number(linked()[1]))
else if (!matchMedia("(prefers-reduced-motion: reduce)").matches) {
  new IntersectionObserver((entries, observer) => {
    if (!entries.some(({isIntersecting}) => isIntersecting)) return
    observer.disconnect()
    if (time > 0 || playing) return
    speed.value = [...speed.options].map(({value}) => value).findLast((value) => Number(value) <= Math.max(1, end() / 30))
    loop(true)
    play(true)
  }).observe(element("play"))
}
document.documentElement.dataset.ready = "true"
