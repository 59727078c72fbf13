"""Blocks of code of a page, with what the page says about running them."""

import re
from dataclasses import dataclass

MARK = re.compile(r"<!-- not run: (.+?) -->")
"""Stands in the line before a block that no test can run, with the reason: a board, ROS 2's own tools, another machine."""
SHELL = ("sh", "bash", "shell")


@dataclass(frozen=True)
class Block:
    """One block of code."""

    language: str  # of a fence; "indented" for one without
    code: str
    not_run: str  # why no test can run it; empty: it has to


def blocks_of(text):
    """All blocks of a page, in order."""
    found, lines, code = [], text.splitlines(), []
    fence, mark, last = None, "", ""
    for line in [*lines, "end"]:
        if fence is not None:
            if line.strip().startswith("```"):
                found.append(Block(fence, "\n".join(code), mark))
                fence, mark, code = None, "", []
            else:
                code.append(line)
        elif opened := re.match(r" *```(\S*)", line):
            if code:
                found.append(Block("indented", "\n".join(code).rstrip(), mark))
                mark = ""
            fence, code = opened[1], []
        elif line.startswith("    ") and (code or not last.strip() or last.startswith("<!--")):
            code.append(line[4:])
        elif line.strip() or code:
            if code and line.strip():
                found.append(Block("indented", "\n".join(code).rstrip(), mark))
                code = []
            elif code:
                code.append("")
            if line.strip():
                said = MARK.search(line)
                mark = said[1] if said else ""
        last = line
    return found


def is_shell(block, commands):
    """Whether a block is for the shell: by its language, or an indented one that begins with a command, and is no output of one."""
    if block.language in SHELL:
        return True
    first, second, *_ = [*block.code.split(None, 2), "", ""]
    known = second.startswith("-") or second in commands or not second
    return block.language == "indented" and bool(re.match(r"[a-z.]\w*$|\.$", first)) and (first != "handwave" or known)


def shell_lines(block):
    """Commands of a block of the shell: comments and redirections left out, lines that go on joined, parts between && apart."""
    for line in re.sub(r" *\\\n *", " ", block.code).splitlines():
        for part in re.split(r"&&|;", re.sub(r"(^| +)#.*| > \S+", "", line)):
            if part.strip():
                yield part.strip()
