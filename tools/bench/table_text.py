# SPDX-License-Identifier: Apache-2.0
"""Cells and tables as they stand in the pages of docs/: Markdown."""


def text_of(head, rows):
    """@param rows  of texts; the first column is to the left"""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines).replace("| --- ", "|---") \
        .replace("|--- |", "|---|").replace("--- |\n", "---|\n")


def percent(value, digits=1):
    return f"{value:.{digits}f} %"


def listed(values):
    """@returns several percentages as one text"""
    return ", ".join(f"{value:.1f}" for value in values) + " %" if values else "not run"


def microseconds(value):
    return f"{value:.1f}" if value < 10 else f"{value:.0f}"
