#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A Slurm cluster of one node on this machine, in a folder of its own: for tests, or to give one big
# machine a queue. Needs the packages slurmctld, slurmd, slurm-client and munge.
#
#   scripts/slurm_local.sh start DIR    then: export SLURM_CONF=DIR/slurm.conf
#   scripts/slurm_local.sh stop DIR
set -euo pipefail
say() { printf 'slurm_local: %s\n' "$*" >&2; }
usage() { sed -n '3,/^[^#]/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; }
case "${1:-}" in
  -h | --help) usage; exit ;;
  start | stop) [ $# = 2 ] || { say "expected a folder after '$1'"; usage >&2; exit 2; } ;;
  *) say "expected start or stop, found '${1:-}'"; usage >&2; exit 2 ;;
esac
mkdir -p "$2"
folder=$(cd "$2" && pwd)
export PATH="$PATH:/usr/sbin:/sbin"

stop() {
  for name in slurmd slurmctld munged; do
    [ -s "$folder/$name.pid" ] || continue
    pid=$(cat "$folder/$name.pid")
    # Another program may have got this number.
    if [ "$(cat "/proc/$pid/comm" 2>/dev/null)" = "$name" ]; then
      kill "$pid" || true
      for _ in $(seq 50); do [ -d "/proc/$pid" ] || break; sleep 0.1; done
    fi
    rm -f "$folder/$name.pid"
  done
}

free_port() { python3 -c 'import socket; s = socket.socket(); s.bind(("", 0)); print(s.getsockname()[1])'; }

start() {
  for program in slurmctld slurmd sbatch munged; do
    command -v "$program" >/dev/null || { say "$program is missing: apt install slurmctld slurmd slurm-client munge"; exit 77; }
  done
  [ "$(id -u)" = 0 ] || { say "slurmd needs root to start jobs"; exit 77; }
  mkdir -p "$folder/state" "$folder/spool"
  chmod 755 "$folder"
  head -c 1024 /dev/urandom >"$folder/munge.key"
  chmod 600 "$folder/munge.key"
  munged --force --key-file="$folder/munge.key" --socket="$folder/munge.socket" --pid-file="$folder/munged.pid" \
    --log-file="$folder/munged.log" --seed-file="$folder/munge.seed" >"$folder/munged.out" 2>&1
  host=$(hostname -s)
  cat >"$folder/slurm.conf" <<CONF
ClusterName=jade
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$(free_port)
SlurmdPort=$(free_port)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
# No control groups: works in containers.
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
ReturnToService=2
JobRequeue=1
KillWait=10
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(env -u OMP_NUM_THREADS nproc) State=UNKNOWN
PartitionName=local Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
  export SLURM_CONF="$folder/slurm.conf"
  slurmctld -f "$folder/slurm.conf" >"$folder/slurmctld.out" 2>&1
  slurmd -f "$folder/slurm.conf" >"$folder/slurmd.out" 2>&1
  for _ in $(seq 100); do
    if [ "$(sinfo -h -o %T 2>/dev/null)" = idle ]; then
      say "$(sinfo --version) on $host with $(env -u OMP_NUM_THREADS nproc) cores; export SLURM_CONF=$folder/slurm.conf"
      return
    fi
    sleep 0.2
  done
  say "the node does not come up; the last words of its logs:"
  tail -n 5 "$folder"/*.log >&2 || true
  stop
  exit 1
}

"$1"
