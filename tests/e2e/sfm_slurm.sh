#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm plan --slurm on a cluster of two nodes on this host: one node dies while it works on a shard, and the model equals
# that of `sfm reconstruct`, byte for byte.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"
[ -n "${TARSIER_TEST_ALL:-}" ] || skip "a cluster of two nodes: runs with ./test --all"
[ "$(id -u)" -eq 0 ] || skip "slurmd needs root"
PATH=$PATH:/usr/sbin:/sbin
for program in munged slurmctld slurmd sbatch squeue sinfo; do
  command -v $program >/dev/null || skip "needs the packages slurmctld slurmd slurm-client munge"
done
SHARDS=8

declare -A daemons # name: process
tasks_of() { # tasks_of NODE: the processes of its tasks, and what watches over each
  local file process
  grep -lzs "^SLURMD_NODENAME=$1\$" /proc/[0-9]*/environ | while read -r file; do
    grep -qz "^SLURM_CONF=$SLURM_CONF\$" "$file" 2>/dev/null || continue
    process=${file//[!0-9]/}
    printf '%s\n' "$process" "$(awk '/^PPid/ {print $2}' "/proc/$process/status" 2>/dev/null)"
  done | grep -vx -e 0 -e 1 -e "$$" | sort -u
}
kill_node() { # kill_node NODE: with its tasks
  local tasks
  tasks=$(tasks_of "$1")
  # shellcheck disable=SC2086
  { kill -KILL "${daemons[$1]}" $tasks; wait "${daemons[$1]}"; } 2>/dev/null
  unset "daemons[$1]"
}
# shellcheck disable=SC2317 # by the trap
stop_all() {
  local name
  for name in n1 n2; do [ -z "${daemons[$name]:-}" ] || kill_node "$name"; done
  for name in "${!daemons[@]}"; do { kill -KILL "${daemons[$name]}"; wait "${daemons[$name]}"; } 2>/dev/null; done
}
begin() { # begin NAME COMMAND..: a daemon in the foreground
  local name=$1
  shift
  "$@" >"$name.out" 2>&1 </dev/null &
  daemons[$name]=$!
}

# --- a cluster of its own: keys, sockets, ports and folders that nobody else uses ---
host=$(hostname -s)
cluster=$(mktemp -d /tmp/tarsier-slurm-XXXXXX) # the path of a socket is short
chmod 755 "$cluster"
trap 'stop_all; rm -rf "$cluster"' EXIT
mkdir "$cluster/munge" "$cluster/state" "$cluster/n1" "$cluster/n2"
chmod 711 "$cluster/munge"
noise 128 >"$cluster/key"
chmod 600 "$cluster/key"
port=$((20000 + $$ % 20000))
export SLURM_CONF=$cluster/slurm.conf
cat >"$SLURM_CONF" <<CONF
ClusterName=tarsier
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$cluster/munge/socket
StateSaveLocation=$cluster/state
SlurmdSpoolDir=$cluster/%n
SlurmctldPidFile=$cluster/slurmctld.pid
SlurmdPidFile=$cluster/%n.pid
SlurmctldLogFile=$cluster/slurmctld.log
SlurmdLogFile=$cluster/%n.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
SlurmdTimeout=6
KillWait=2
SchedulerParameters=sched_interval=1,batch_sched_delay=0,requeue_delay=1
ReturnToService=2
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 1)) CPUs=1
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 2)) CPUs=1
PartitionName=all Nodes=n1,n2 Default=YES State=UP
CONF
begin munged munged --foreground --force --key-file="$cluster/key" --socket="$cluster/munge/socket" --pid-file="$cluster/munge/pid" \
  --log-file="$cluster/munge/log" --seed-file="$cluster/munge/seed"
for _ in $(seq 100); do [ -S "$cluster/munge/socket" ] && break; sleep 0.1; done
begin slurmctld slurmctld -D -c
begin n1 slurmd -D -N n1
begin n2 slurmd -D -N n2
for _ in $(seq 300); do
  [ "$(sinfo -h -t idle -o %D 2>/dev/null)" = 2 ] && break
  sleep 0.2
done
[ "$(sinfo -h -t idle -o %D 2>/dev/null)" = 2 ] || skip "Slurm does not run here: $(tail -qn 2 ./*.out "$cluster"/*.log | tail -3 | tr '\n' ' ')"

# --- the work ---
run sfm synth -o scene --images "${SLURM_TEST_IMAGES:-40}" --size 480x360 --seed 5
expect_status 0
options=(--camera-file scene/camera.yaml --max-features 1000)
run sfm reconstruct scene/images "${options[@]}" -o whole --quiet
expect_status 0
run sfm plan scene/images "${options[@]}" -o work --shards $SHARDS --slurm
expect_status 0
submit() { bash work/sfm.sbatch >submitted.txt 2>&1 || fail "sfm.sbatch: $(cat submitted.txt)"; }
submit
# The first task of the first node is killed together with its node.
for _ in $(seq 6000); do
  process=$(tasks_of n1 | paste -sd,)
  [ -z "$process" ] || ps -o args= -p "$process" | grep -q 'sfm features' && break
  sleep 0.01
done
was_done=$(find work -name 'features-*.done' | wc -l)
kill_node n1
[ "$was_done" -lt $SHARDS ] || fail "all features were found before the node was killed"
wait_for_queue() { # until there are no jobs
  local deadline=$((SECONDS + ${TARSIER_TEST_TIMEOUT:-300}))
  until [ -z "$(squeue -h 2>/dev/null)" ]; do
    [ $SECONDS -lt $deadline ] || { fail "jobs are left: $(squeue)"; return; }
    sleep 0.5
  done
}
wait_for_queue
again=0
if [ ! -s work/model/points3D.txt ]; then # the documented way: the same command does what is not done
  again=1
  submit
  wait_for_queue
fi
printf 'node n1 killed with %d of %d shards of features done; submitted again: %d\n' "$was_done" $SHARDS $again
sinfo -h -N -o '%N %t'
[ "$(find work -name 'features-*.done' | wc -l)" -eq $SHARDS ] || fail "shards are missing: $(ls work)"
for file in cameras.txt images.txt points3D.txt points.ply; do
  cmp "work/model/$file" "whole/$file" || fail "one of two nodes killed: another $file"
done
finish
