#!/bin/bash
# Renders with a Slurm that runs on this machine alone: a controller and a node that are started here, on ports of their
# own, and stopped at the end by their process ids. One task is killed, one is requeued by the operator. The merged
# image must have the bits of one process. Needs root, for munge and Slurm (packages slurm-wlm and munge).
set -euo pipefail
buffon=$(realpath "${1:?usage: slurm.sh PATH/TO/buffon SCENE}")
scene=$(realpath "$2")
work=$(mktemp -d)
# Slurm's jobs may write here whoever runs them.
chmod 755 "$work"
started=()

stop() {
    for pid in "${started[@]}"; do kill "$pid" 2>/dev/null || true; done
    # They write files in the folder until they end.
    for pid in "${started[@]}"; do wait "$pid" 2>/dev/null || true; done
    rm -rf "$work"
}
trap stop EXIT
fail() {
    echo "slurm.sh: $*" >&2
    tail -n 20 "$work"/*.log "$work"/run/farm/logs/*.log >&2 || true
    exit 1
}
# Waits at most a minute until a command succeeds.
until_true() {
    for _ in $(seq 120); do "$@" >/dev/null 2>&1 && return; sleep 0.5; done
    fail "waited in vain for: $*"
}

host=$(hostname -s)
mkdir -p "$work"/{state,spool,munge,run}
dd if=/dev/urandom of="$work/munge/key" bs=1024 count=1 status=none
chown -R munge:munge "$work/munge"
chmod 700 "$work/munge" && chmod 400 "$work/munge/key"
socket=/run/munge/munge.socket.2
if [ ! -S "$socket" ]; then
    mkdir -p /run/munge && chown munge:munge /run/munge
    runuser -u munge -- /usr/sbin/munged --foreground --key-file="$work/munge/key" --socket="$socket" \
        --pid-file="$work/munge/pid" --log-file="$work/munge/log" --seed-file="$work/munge/seed" &
    started+=($!)
    until_true test -S "$socket"
fi
cat >"$work/slurm.conf" <<EOF
ClusterName=buffon
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=26817
SlurmdPort=26818
SlurmUser=root
AuthType=auth/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
MpiDefault=none
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
KillWait=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc)
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
EOF
export SLURM_CONF=$work/slurm.conf
slurmctld -D -f "$SLURM_CONF" >"$work/slurmctld.log" 2>&1 &
started+=($!)
slurmd -D -f "$SLURM_CONF" >"$work/slurmd.log" 2>&1 &
started+=($!)
until_true sh -c 'sinfo -h -o %T | grep -q -E "idle|mixed"'

cd "$work/run"
export BUFFON=$buffon
options=(--spp 1024 --size 320x240 --aov variance)
"$buffon" render "$scene" -q "${options[@]}" -o whole.exr
"$buffon" plan "$scene" --engine slurm --tasks 16 --regions 2 --dir farm -- "${options[@]}" -t 1 --checkpoint-every 1s
sh farm/submit.sh
name=$(basename "${scene%.*}")
# The first task is killed once it has a checkpoint; another one is requeued.
until_true test -e "farm/parts/$name/00000.sums"
victim=$(pgrep -f "parts/$name/00000.sums" | head -n 1) || fail "the first task ended before it could be killed"
kill -KILL "$victim" && echo "killed task 1, process $victim"
until_true sh -c 'squeue -h -r -t RUNNING -n buffon -o %i | grep -q .'
other=$(squeue -h -r -t RUNNING -n buffon -o %i | tail -n 1)
scontrol requeue "$other" && echo "requeued $other"
for _ in $(seq 600); do
    [ -z "$(squeue -h -o %i)" ] && break
    sleep 1
done
[ -e "farm/images/$name.exr" ] || fail "there is no merged image"
"$buffon" diff "farm/images/$name.exr" whole.exr --metric max
hash() { "$buffon" convert "$1" "$2" && sha256sum <"$2"; }
merged=$(hash "farm/images/$name.exr" merged.pfm)
whole=$(hash whole.exr whole.pfm)
echo "merged $merged"
echo "whole  $whole"
[ "$merged" = "$whole" ] || fail "the images differ"
