// Listeners of controls, keys, links and growing drives, and the start. Its names come from the other files.
slider.addEventListener("input", () => seek(Number(slider.value)))
play_button.addEventListener("click", () => set_playing(!playing))
live_button?.addEventListener("click", () => set_following(!following))
const step = (event) => event.shiftKey ? 1 : 0.1
const keys = {
  " ": () => set_playing(!playing), ArrowRight: (event) => seek(time + step(event)), ArrowLeft: (event) => seek(time - step(event)),
  Home: () => seek(0), End: () => seek(end()), l: () => set_looping(!looping), n: () => seek_event(1), p: () => seek_event(-1),
  f: () => element("follow").click(), r: reset, "+": () => zoom(1 / 1.2), "-": () => zoom(1.2),
}
document.addEventListener("keydown", (event) => {
  const act = keys[event.key] ?? keys[event.key.toLowerCase()]
  if (!act || event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select")) return
  if (event.key === " " && event.target.matches("button")) return
  event.preventDefault()
  act(event)
})
function set_looping(on) {
  looping = on
  loop_button.setAttribute("aria-pressed", String(on))
}
loop_button.addEventListener("click", () => set_looping(!looping))
// A link to a moment: #t=12.3
function seek_linked() {
  const linked = /^#t=([0-9.]+)$/.exec(location.hash)
  if (linked && Number.isFinite(Number(linked[1]))) seek(Number(linked[1]))
}
element("link").addEventListener("click", () => {
  history.replaceState(null, "", `#t=${time.toFixed(1)}`)
  navigator.clipboard?.writeText(location.href).catch(() => {})
})
addEventListener("hashchange", seek_linked)
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { paint(); draw() })
let waiting = false
const soon = () => {  // several columns may grow at once
  if (!waiting) {
    waiting = true
    requestAnimationFrame(() => { waiting = false; grow() })
  }
}
for (const {rows} of runs) {
  rows.streaming.connect(soon)
  rows.properties.data.change.connect(soon)
}
window.watch = {
  seek, play: () => set_playing(true), pause: () => set_playing(false), get time() { return time }, get end() { return end() },
  get playing() { return playing }, get camera() { return {...camera} }, get events() { return all_events() },
}
paint()
arrange()
settle()
grow()
seek_linked()
document.documentElement.dataset.ready = "true"
