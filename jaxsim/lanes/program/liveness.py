"""Dead code: which nodes of a program some result needs."""

import numpy as np

from jaxsim.lanes.program.graph import CONST, CONTROL, INPUT, LOAD, PACK, PARAM, RESULT, Graph, Loop


def operands(graph: Graph, node: int) -> list[int]:
    """The nodes that a node reads, controls aside."""
    op = graph.op[node]
    if op in (CONST, INPUT, PARAM, CONTROL):
        return []
    if op == PACK:
        return graph.packs[graph.args[node, 0]].tolist()
    row = graph.args[node].tolist()
    if op == LOAD:
        return row[:2]
    if op == RESULT:
        return row[:1]
    return [a for a in row if a >= 0]


def live(graph: Graph, outputs: np.ndarray) -> np.ndarray:
    """A flag for each node; of loops and branches only the results that are needed count."""
    found = np.zeros(graph.size, bool)
    stack = [int(i) for i in outputs]
    param_of = {
        int(p): (control, k)
        for control in graph.controls
        if isinstance(control, Loop)
        for k, p in enumerate(control.params)
    }
    while stack:
        node = stack.pop()
        if found[node]:
            continue
        found[node] = True
        op = graph.op[node]
        if op == RESULT:
            control = graph.controls[graph.args[graph.args[node, 0], 0]]
            k = int(graph.args[node, 1])
            stack.append(control.node)
            if isinstance(control, Loop):
                stack.append(int(control.params[k]))
            else:
                stack.extend(int(out[k]) for out in control.outs)
        elif op == PARAM:
            control, k = param_of[node]
            stack += [int(control.inits[k]), int(control.nexts[k]), control.node]
        elif op == CONTROL:
            control = graph.controls[graph.args[node, 0]]
            stack += [control.proceed] if isinstance(control, Loop) else control.which
        else:
            stack.extend(operands(graph, node))
    return found
