#!/usr/bin/env bash
# A search for hyper-parameters by an array of jobs that share one study: sbatch slurm.sh
# Each job takes trials until the study has TRIALS of them; jobs may come late, and may be killed.
#SBATCH --job-name=turtlebot-tune
#SBATCH --array=0-15
#SBATCH --ntasks=1
#SBATCH --cpus-per-task=1
#SBATCH --mem=2G
#SBATCH --time=04:00:00
#SBATCH --output=tune-%A-%a.log
set -euo pipefail

SHARED=${SHARED:-$PWD/runs/tune}  # on a file system that all nodes see
TRIALS=${TRIALS:-200}
STEPS=${STEPS:-500000}

# The cache of machine code: one for each node and user, which the node's first job fills
export TURTLEBOT_GYM_CACHE_DIR=${TURTLEBOT_GYM_CACHE_DIR:-/tmp/turtlebot_gym-$(id -u)}
export OMP_NUM_THREADS=${SLURM_CPUS_PER_TASK:-1} TURTLEBOT_GYM_THREADS=${SLURM_CPUS_PER_TASK:-1}

mkdir -p "$SHARED"
echo "job ${SLURM_ARRAY_TASK_ID:-0} on $(hostname)"
turtlebot-gym tune --storage "$SHARED/study.journal" --out "$SHARED/job-${SLURM_ARRAY_TASK_ID:-0}" \
    --trials "$TRIALS" --steps "$STEPS" "$@"
