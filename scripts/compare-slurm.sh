#!/bin/bash
# A comparison as a Slurm array of 20 parts. Submit it, then the joining, which waits for all of them:
#   array=$(sbatch --parsable scripts/compare-slurm.sh)
#   sbatch --dependency=afterok:"$array" --wrap 'senda merge $(seq -f part-%g 20) --out whole --report report.html --markdown report.md'
# A part that was cut off by the time limit goes on when it is submitted again: sbatch --array=7 scripts/compare-slurm.sh
#SBATCH --job-name=senda-compare
#SBATCH --array=1-20
#SBATCH --cpus-per-task=2
#SBATCH --mem=4G
#SBATCH --time=04:00:00
#SBATCH --output=part-%a.log
set -euo pipefail
srun senda compare --preset document-b --shard "${SLURM_ARRAY_TASK_ID}/20" \
  --folder "part-${SLURM_ARRAY_TASK_ID}" --jobs "${SLURM_CPUS_PER_TASK}"
