# SPDX-License-Identifier: Apache-2.0
"""The ways of letting launches go that have to wait, as scripts name them, and in a config."""

DISPATCH = {"thread": "thread", "host": "host", "piggyback": "device, device: piggyback",
            "leased": "device, device: leased", "armed": "device, device: armed"}


def dispatch_key(row):
    """@returns ", dispatch: ..." for a config's scheduler; '' of a row that is no way of it"""
    return f", dispatch: {{where: {DISPATCH[row]}}}" if row in DISPATCH else ""
