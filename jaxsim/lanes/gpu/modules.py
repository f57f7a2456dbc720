"""A program in LLVM's text as several modules, which can be compiled at the same time."""

import re

# The header up to the last parenthesis, the name, the body.
DEFINITION = re.compile(
    r"^define (?:internal )?([^@\n]*@(\w+)\([^\n]*\))[^()\n]*\{$.*?^\}$", re.MULTILINE | re.DOTALL
)
DECLARATION = re.compile(r"^declare .*?(@[\w.]+)\(.*$", re.MULTILINE)
TABLE = re.compile(r"^(@\w+) = .*$", re.MULTILINE)
CALLED = re.compile(r"@[\w.]+")


def divide(text: str, count: int) -> list[str]:
    """Modules that call each other's functions, each with about as much text.

    Args:
      text: a program whose functions have one definition each; constants are copied.
      count: number of modules; fewer for a program of fewer functions.
    """
    definitions = {f"@{m[2]}": m for m in DEFINITION.finditer(text)}
    outside = {m[1]: m[0] for m in DECLARATION.finditer(text)}
    tables = {m[1]: m[0] for m in TABLE.finditer(text)}
    shares: list[list[str]] = [[] for _ in range(min(count, len(definitions)))]
    sizes = [0] * len(shares)
    for name in sorted(definitions, key=lambda n: -len(definitions[n][0])):
        smallest = sizes.index(min(sizes))
        shares[smallest].append(name)
        sizes[smallest] += len(definitions[name][0])
    return [_module(share, definitions, outside | tables) for share in shares]


def _module(share: list[str], definitions: dict[str, re.Match], others: dict[str, str]) -> str:
    """The functions of a share, and what they refer to."""
    bodies = [definitions[name][0].replace("define internal", "define", 1) for name in share]
    used = sorted(set(CALLED.findall("\n".join(bodies))) - set(share))
    declared = [others[n] if n in others else f"declare {definitions[n][1]}" for n in used]
    return "\n".join((*declared, *bodies))
