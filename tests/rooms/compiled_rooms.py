"""Parts of rooms that several files of tests call, compiled once for all."""

from turtlebot_gym.compiled.program import compiled
from turtlebot_gym.rooms import drawing, sensing

draw_compiled = compiled(lambda scene, rules, radius, key: drawing.draw(scene, rules, radius, key, 0.1), "rooms in tests")
clearance_compiled = compiled(lambda scene, x, y: sensing.clearance(scene, x, y), "clearance in tests")
