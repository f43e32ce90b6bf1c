// What moves: drawn into the overlay layer of Bokeh's canvases, so that another moment costs neither a new map nor new axes.
// Its names come from view.py: inks, which are colours on light pages and on dark ones; and from timeline.js: hidden layers.
const FULL_TURN = 2 * Math.PI
let shade = 0

// Let a function draw into a figure's overlay layer, clipped to its frame. Returns a function that draws the layer at once.
// _paint_overlays and _invalidated_painters are private, hence Bokeh's upper bound in pyproject.toml.
function overlay(view, paint) {
  const others = view._paint_overlays.bind(view), layer = {model: {level: "overlay"}}
  view._paint_overlays = (ctx) => {
    others(ctx)
    const {x, y, width, height} = view.frame.bbox
    ctx.save()
    ctx.beginPath()
    ctx.rect(x, y, width, height)
    ctx.clip()
    paint(ctx, view.frame)
    ctx.restore()
  }
  return () => {
    view._invalidated_painters.add(layer)
    view.paint()
  }
}

// A line at a time.
function paint_cursor(ctx, frame, t) {
  const x = frame.x_scale.compute(t), {y, height} = frame.bbox
  ctx.strokeStyle = inks.text[shade]
  ctx.lineWidth = 1.5
  ctx.beginPath()
  ctx.moveTo(x, y)
  ctx.lineTo(x, y + height)
  ctx.stroke()
}

// Row k of a run: obstacles, waypoint, scan, the other robot, other hypotheses, paths so far, robot, odometry, and the
// estimate with its ellipse.
function paint_moment(ctx, frame, {data, k, points, circles, other, sizes: [robot, goal]}) {
  const origin_x = frame.x_scale.compute(0), origin_y = frame.y_scale.compute(0)
  const along = frame.x_scale.compute(1) - origin_x, up = frame.y_scale.compute(1) - origin_y  // pixels per metre
  const X = (x) => origin_x + along * x, Y = (y) => origin_y + up * y

  const oval = (x, y, a, b, tilt = 0) => ctx.ellipse(X(x), Y(y), a * along, b * along, -tilt, 0, FULL_TURN)
  const fill = (ink, alpha) => {
    ctx.globalAlpha = alpha
    ctx.fillStyle = inks[ink][shade]
    ctx.fill()
    ctx.globalAlpha = 1
  }
  const stroke = (ink, width, dash = []) => {
    ctx.setLineDash(dash)
    ctx.strokeStyle = inks[ink][shade]
    ctx.lineWidth = width
    ctx.stroke()
  }
  const disc = (x, y, radius, ink, alpha, width) => {
    if (!Number.isFinite(x + y)) return
    ctx.beginPath()
    oval(x, y, radius, radius)
    fill(ink, alpha)
    if (width > 0) stroke(ink, width)
  }
  const pointer = (x, y, theta, length, ink, width) => {
    if (!Number.isFinite(x + y + theta)) return
    ctx.beginPath()
    ctx.moveTo(X(x), Y(y))
    ctx.lineTo(X(x + length * Math.cos(theta)), Y(y + length * Math.sin(theta)))
    stroke(ink, width)
  }
  const dots = (x, y, count, radius, ink, alpha) => {
    ctx.beginPath()
    for (let at = 0; at < count; at++) {
      if (Number.isFinite(x[at] + y[at])) {
        const u = X(x[at]), v = Y(y[at])
        ctx.moveTo(u + radius, v)
        ctx.arc(u, v, radius, 0, FULL_TURN)
      }
    }
    fill(ink, alpha)
  }
  const path = (x, y, ink, width, dash) => {
    let known = false
    ctx.beginPath()
    for (let at = 0; at <= k; at++) {
      if (!Number.isFinite(x[at] + y[at])) { known = false; continue }
      if (known) ctx.lineTo(X(x[at]), Y(y[at]))
      else ctx.moveTo(X(x[at]), Y(y[at]))
      known = true
    }
    stroke(ink, width, dash)
  }

  const shown = (layer) => !hidden.has(layer)
  ctx.lineCap = "round"
  ctx.lineJoin = "round"
  if (other && shown("other")) {  // where the other of two drives is at the same time
    const {data: {x: u, y: v, theta: turn, ex: eu, ey: ev, etheta: eturn}, k: at} = other, known = Number.isFinite(u[at])
    const place = known ? [u[at], v[at], turn[at]] : [eu[at], ev[at], eturn[at]]
    ctx.beginPath()
    oval(place[0], place[1], robot, robot)
    stroke("text", 1.5, [3, 3])
    pointer(...place, robot, "text", 1.5)
  }
  if (shown("hypotheses")) {
    const places = data.hypotheses[k]
    for (let at = 0; at + 3 < places.length; at += 4) {
      const weight = 0.15 + 0.6 * places[at + 3]
      disc(places[at], places[at + 1], robot, "estimate", weight, 1)
      pointer(places[at], places[at + 1], places[at + 2], 1.8 * robot, "estimate", 1.5)
    }
  }
  const {x, y, theta, ex, ey, etheta, ox, oy, otheta, gx, gy, gtheta, width, height, tilt} = data
  for (let at = 0; at + 2 < circles.length; at += 3) disc(circles[at], circles[at + 1], circles[at + 2], "solid", 1, 0)
  if (shown("waypoint")) {
    disc(gx[k], gy[k], goal, "goal", 0.15, 2)
    pointer(gx[k], gy[k], gtheta[k], goal, "goal", 2)
  }
  if (shown("scan")) dots(points.x, points.y, points.x.length, 1.5, "scan", 1)
  if (shown("odometry")) dots(ox, oy, k + 1, 1.25, "odometry", 0.7)
  if (shown("truth")) path(x, y, "truth", 2.4, [])
  if (shown("estimate")) path(ex, ey, "estimate", 1.5, [6, 3])
  const known = Number.isFinite(x[k])  // without a known truth the robot is drawn where it believes it is
  disc(known ? x[k] : ex[k], known ? y[k] : ey[k], robot, "truth", 0.2, 2)
  pointer(x[k], y[k], theta[k], robot, "truth", 3)
  if (shown("odometry")) {
    dots([ox[k]], [oy[k]], 1, 3.5, "odometry", 1)
    pointer(ox[k], oy[k], otheta[k], robot, "odometry", 2)
  }
  if (!shown("estimate")) return
  if (Number.isFinite(ex[k] + ey[k] + width[k] + tilt[k])) {
    ctx.beginPath()
    oval(ex[k], ey[k], width[k] / 2, height[k] / 2, tilt[k])
    fill("estimate", 0.15)
    stroke("estimate", 1.5)
  }
  pointer(ex[k], ey[k], etheta[k], 1.5 * robot, "estimate", 2)
}
