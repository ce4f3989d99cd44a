#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
#
# prints.sh REGEX COMMAND...: succeeds if COMMAND does and its output, lines joined, has REGEX. With
# CTest's PASS_REGULAR_EXPRESSION alone the exit status would not count.
pattern=$1
shift
output=$("$@" 2>&1)
status=$?
printf '%s\n' "$output"
[ "$status" -eq 0 ] || {
    echo "prints.sh: exit status $status, accepted: 0"
    exit "$status"
}
printf '%s' "$output" | tr '\n' ' ' | grep -Eq -- "$pattern" || {
    echo "prints.sh: found no '$pattern' in that"
    exit 1
}
