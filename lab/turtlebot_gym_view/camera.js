// The view that the maps share: its middle, and the metres of a pixel. It follows the drives until somebody moves it, and then
// holds, whatever happens to the size of the frames. Its names come from view.py: runs; and from client.js.
const camera = {x: 0, y: 0, metres: 0.01, held: false}
const CLOSEST = 1e-4, FARTHEST = 1  // metres of a pixel
let followed = -1  // the run whose robot stays in the middle

const map_elements = [...document.querySelectorAll(".map")]
const map_views = runs.map(({figure}) => cb_context.index[figure.id])

function aim() {
  const [{figure}] = runs
  const size = [figure.inner_width, figure.inner_height]
  if (!(size[0] > 0 && size[1] > 0)) return
  const ends = (middle, pixels) => ({start: middle - 0.5 * camera.metres * pixels, end: middle + 0.5 * camera.metres * pixels})
  set(figure.x_range, ends(camera.x, size[0]))
  set(figure.y_range, ends(camera.y, size[1]))
}

// Show everything, with the same scale along x and y.
function fit() {
  const [{figure}] = runs
  if (!(figure.inner_width > 0 && figure.inner_height > 0)) return
  const [low_x, low_y, high_x, high_y] = [0, 1, 2, 3].map((at) => runs.map(({seen}) => seen[at]).reduce((a, b) => at < 2 ? Math.min(a, b) : Math.max(a, b)))
  camera.metres = Math.max((high_x - low_x) / figure.inner_width, (high_y - low_y) / figure.inner_height)
  camera.x = 0.5 * (low_x + high_x)
  camera.y = 0.5 * (low_y + high_y)
  aim()
}

const settle = () => camera.held ? aim() : fit()

function reset() {
  camera.held = false
  follow(-1)
  fit()
}

function zoom(factor, x = camera.x, y = camera.y) {
  const metres = Math.min(Math.max(camera.metres * factor, CLOSEST), FARTHEST)
  const by = metres / camera.metres
  if (followed < 0) {
    camera.x = x + (camera.x - x) * by
    camera.y = y + (camera.y - y) * by
  }
  camera.metres = metres
  camera.held = true
  aim()
}

function pan(right, down) {
  follow(-1)
  camera.x -= right * camera.metres
  camera.y += down * camera.metres
  camera.held = true
  aim()
}

function follow(run) {
  if (run >= 0 && followed < 0 && !camera.held) camera.metres *= 0.5
  followed = run
  element("follow").setAttribute("aria-pressed", String(run >= 0))
  if (run >= 0) {
    camera.held = true
    keep_up()
  }
}

// Put the robot that is followed into the middle.
function keep_up() {
  if (followed < 0) return
  const {rows: {data}} = runs[followed], k = row_at(data.time, time)
  const [x, y] = Number.isFinite(data.x[k]) ? [data.x[k], data.y[k]] : [data.ex[k], data.ey[k]]
  if (!Number.isFinite(x + y)) return
  camera.x = x
  camera.y = y
  aim()
}

// The place in a figure under a pointer, in its units.
function place_in(view, {clientX, clientY}) {
  const {left, top} = view.el.getBoundingClientRect(), {frame} = view
  return [frame.x_scale.invert(clientX - left), frame.y_scale.invert(clientY - top)]
}

map_elements.forEach((map, at) => {
  const fingers = new Map(), view = map_views[at]
  const middle = () => {
    const all = [...fingers.values()], mean = (name) => all.reduce((sum, finger) => sum + finger[name], 0) / all.length
    const x = mean("clientX"), y = mean("clientY")
    return {clientX: x, clientY: y, spread: all.reduce((sum, finger) => sum + Math.hypot(finger.clientX - x, finger.clientY - y), 0)}
  }
  map.addEventListener("wheel", (event) => {
    event.preventDefault()
    event.stopPropagation()
    const notches = event.deltaY / (event.deltaMode === 1 ? 3 : 100)
    zoom(1.2 ** Math.min(Math.max(notches, -3), 3), ...place_in(view, event))
  }, {passive: false, capture: true})
  map.addEventListener("pointerdown", (event) => {
    if (event.button === 0 && event.isTrusted) map.setPointerCapture(event.pointerId)
    if (event.button === 0) fingers.set(event.pointerId, event)
  }, true)
  map.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return
    const before = middle()
    fingers.set(event.pointerId, event)
    const after = middle()
    pan(after.clientX - before.clientX, after.clientY - before.clientY)
    if (fingers.size > 1 && before.spread > 0 && after.spread > 0) zoom(before.spread / after.spread, ...place_in(view, after))
  }, true)
  for (const name of ["pointerup", "pointercancel"]) map.addEventListener(name, (event) => fingers.delete(event.pointerId), true)
  map.addEventListener("dblclick", reset, true)
})

// Arrange the maps in the number of columns in which they are largest, where they share a window.
function arrange() {
  const maps = document.querySelector(".maps"), count = runs.length, {clientWidth: width, clientHeight: height} = maps
  if (getComputedStyle(document.querySelector("main")).overflow === "visible") {  // a narrow page: one below the other
    maps.style.gridTemplate = ""
    return
  }
  const [{seen}] = runs, aspect = (seen[2] - seen[0]) / (seen[3] - seen[1])
  let best = [0, 1]
  for (let columns = 1; columns <= count; columns++) {
    const rows = Math.ceil(count / columns), high = height / rows - 70  // below heading and numbers
    const scale = Math.min(width / columns / aspect, high)
    if (scale > best[0]) best = [scale, columns]
  }
  const part = (number) => `repeat(${number}, minmax(0, 1fr))`
  maps.style.gridTemplate = `${part(Math.ceil(count / best[1]))} / ${part(best[1])}`
}

element("reset").addEventListener("click", reset)
element("follow").addEventListener("click", () => follow(followed < 0 ? 0 : followed + 1 < runs.length ? followed + 1 : -1))
for (const side of ["inner_width", "inner_height"]) runs[0].figure.properties[side].change.connect(settle)
addEventListener("resize", arrange)
