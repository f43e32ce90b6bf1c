// What the browser does: it shows the drives at a time, and lets that time be scrubbed, played and followed.
// Its names come from view.py: runs, plots, time_range, theme, live; from present.js, camera.js and timeline.js.
const element = (name) => document.getElementById(name)
const slider = element("time"), play_button = element("play"), speed = element("speed"), live_button = element("live")
const loop_button = element("loop")
let time = 0, playing = false, following = live, looping = false, last_frame = 0

const end = () => runs.reduce((latest, {rows}) => Math.max(latest, rows.data.time[rows.data.time.length - 1] ?? 0), 0)

// The last row at or before a time, or the first one.
function row_at(times, t) {
  let low = 0, high = times.length
  while (low < high) {
    const middle = (low + high) >> 1
    if (times[middle] <= t + 1e-4) low = middle + 1
    else high = middle
  }
  return Math.max(low - 1, 0)
}

// The state of the view is this browser's own, and not sent to a server.
const set = (model, values) => model.setv(values, {sync: false})

// Where a scan's beams ended.
function points_of(scans, at) {
  const x = [], y = []
  if (at >= 0 && at < scans.x.length) {
    const ranges = scans.ranges[at]
    for (let beam = 0; beam < ranges.length; beam++) {
      if (ranges[beam] > 0) {
        const angle = scans.theta[at] + scans.first[at] + beam * scans.increment[at]
        x.push(scans.x[at] + 1e-3 * ranges[beam] * Math.cos(angle))
        y.push(scans.y[at] + 1e-3 * ranges[beam] * Math.sin(angle))
      }
    }
  }
  return {x, y}
}

const escaped = (text) => text.replace(/[&<>]/g, (sign) => ({"&": "&amp;", "<": "&lt;", ">": "&gt;"})[sign])

function words(data, k) {
  const items = [], add = (name, value, digits, unit) => {
    if (Number.isFinite(value)) items.push(`<span>${name} <b>${value.toFixed(digits)}${unit}</b></span>`)
  }
  const known = Number.isFinite(data.x[k])
  add("to the waypoint", Math.hypot(data.gx[k] - (known ? data.x[k] : data.ex[k]), data.gy[k] - (known ? data.y[k] : data.ey[k])), 2, " m")
  add("estimate off by", data.error[k], 3, " m")
  add("odometry off by", data.odometry_error[k], 3, " m")
  add("speed", data.command_v[k], 2, " m/s")
  add("turning", data.command_omega[k], 2, " rad/s")
  add("NIS", data.nis[k], 1, "")
  add("clearance", data.clearance[k], 2, " m")
  add("from the other", (data.apart ?? [])[k], 2, " m")
  if (data.hypotheses[k].length > 0) add("other places", data.hypotheses[k].length / 4, 0, "")
  if (data.report[k]) items.push(`<span class="report">guard <b>${escaped(data.report[k])}</b></span>`)
  return items.join("")
}

// What is drawn of each run, and the functions that draw it.
const moments = runs.map(({rows, scans, figure, still, sizes}, at) => {
  const moment = {data: rows.data, k: -1, scan: "", points: {x: [], y: []}, circles: still, sizes, readout: element(`readout${at}`)}
  const repaint = overlay(cb_context.index[figure.id], (ctx, frame) => { if (moment.k >= 0) paint_moment(ctx, frame, moment) })
  return {moment, rows, scans, still, repaint}
})
if (moments.length === 2) moments.forEach(({moment}, at) => { moment.other = moments[1 - at].moment })
const cursors = plots.map(({figure}) => overlay(cb_context.index[figure.id], (ctx, frame) => paint_cursor(ctx, frame, time)))

function draw() {
  for (const {moment, rows, scans, still} of moments) {
    const data = rows.data
    if (data.time.length === 0) continue
    const k = row_at(data.time, time), scan = `${data.scan[k]}/${scans.data.x.length}`
    if (moment.scan !== scan) {
      moment.scan = scan
      moment.points = points_of(scans.data, data.scan[k])
    }
    moment.data = data
    moment.circles = data.circles[k].length > 0 ? data.circles[k] : still
    if (moment.k !== k || moment.rows !== data.time.length) moment.readout.innerHTML = words(data, k)
    moment.k = k
    moment.rows = data.time.length
  }
  for (const {repaint} of moments) repaint()
  for (const repaint of cursors) repaint()
  keep_up()
  slider.value = time
  element("clock").textContent = `${time.toFixed(1)} / ${end().toFixed(1)} s`
}

function show(t) {
  time = Math.min(Math.max(t, 0), end())
  draw()
}

function set_playing(on) {
  if (on && time >= end() - 1e-6 && !live) time = 0
  playing = on
  play_button.textContent = on ? "\u275a\u275a" : "\u25b6"
  play_button.setAttribute("aria-label", on ? "pause" : "play")
  if (on) {
    set_following(false)
    last_frame = performance.now()
    requestAnimationFrame(frame)
  }
}

function set_following(on) {
  following = on && live
  live_button?.setAttribute("aria-pressed", String(following))
  if (following) {
    playing = false
    play_button.textContent = "\u25b6"
    show(end())
  }
}

function frame(at) {
  if (!playing) return
  const t = time + Math.max(at - last_frame, 0) * 1e-3 * Number(speed.value)
  last_frame = at
  show(t)
  if (time >= end() - 1e-6 && looping) show(0)
  else if (time >= end() - 1e-6) return set_playing(false)
  requestAnimationFrame(frame)
}

function seek(t) {
  set_playing(false)
  set_following(false)
  show(t)
}

// Widen the visible area to the places and the goals of the drives; returns whether that was necessary.
function widen() {
  let wider = false
  for (const {rows, seen, sizes} of runs) {
    const {x, y, ex, ey, gx, gy} = rows.data
    for (let at = rows.reach ?? 0; at < x.length; at++) {
      const [u, v] = Number.isFinite(x[at]) ? [x[at], y[at]] : [ex[at], ey[at]]
      for (const [p, q, r] of [[u, v, sizes[0]], [gx[at], gy[at], sizes[1]]]) {
        const around = [p - r, q - r, p + r, q + r]
        for (const side of [0, 1, 2, 3]) {
          if (side < 2 ? around[side] < seen[side] : around[side] > seen[side]) {
            seen[side] = around[side] + (side < 2 ? -1 : 1)  // a metre more, so that it is seldom necessary
            wider = true
          }
        }
      }
    }
    rows.reach = x.length
  }
  return wider
}

function grow() {
  if (widen()) settle()
  read_events()
  choose_plots()
  slider.max = end()
  set(time_range, {end: Math.max(end(), 1)})
  if (following) time = end()
  draw()
}

function paint() {
  shade = matchMedia("(prefers-color-scheme: dark)").matches ? 1 : 0
  for (const [model, name, ...values] of theme) set(model, {[name]: values[shade]})
}
