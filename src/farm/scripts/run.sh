#!/bin/sh
# Runs the tasks, and the merges after them. Arguments are passed to parallel, such as --sshlogin.
set -e
cd "$(dirname "$0")"
folder=$PWD
cd @BACK@
parallel --jobs 1 --retries @RETRIES@ --workdir "$PWD" "$@" < "$folder/@TASKS@"
parallel --jobs 1 < "$folder/@MERGES@"
