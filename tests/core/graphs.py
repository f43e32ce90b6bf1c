"""Graphs computed in Python, one node after the other."""

from turtlebot_gym.compiled import graph
from turtlebot_gym.compiled.graph import Node, live


def computed(values, **numbers):
    """Return the results of a graph for given loads."""
    known = {}
    for node in live(values):
        if node.op == "load" and node.args[0] in numbers:
            known[node.id] = numbers[node.args[0]]
        elif node.op == "search":
            found = None
            for attempt in range(node.args[2]):
                found, accepted = computed(node.args[:2], **numbers, **{node.args[4].args[0]: attempt})
                if accepted:
                    break
            known[node.id] = found
        elif node.op != "load" and not {x.id for x in node.args if isinstance(x, Node)} - known.keys():
            args = [known[x.id] if isinstance(x, Node) else x for x in node.args]
            select = node.op in ("sel", "if")
            known[node.id] = (args[1] if args[0] else args[2]) if select else graph._compute(node.op, node.kind, tuple(args))
    return [known[value.id] if isinstance(value, Node) else value for value in values]
