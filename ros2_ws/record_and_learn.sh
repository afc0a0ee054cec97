#!/usr/bin/env bash
# Goes all the way round: ride, record with exploration, learn from the bags alone, ride again, compare.
#
# Usage: record_and_learn.sh [--policy NAME] [--minutes M] [--sigmas "S..."] [--updates U] [--goals N]
#                            [--seed S] [--output FOLDER]
#
#   --policy NAME     what rides and records first: lqr unless named, a policy file or a shipped one
#   --minutes M       of simulated time to record in all, 60 unless named
#   --sigmas "S..."   sizes of the exploration noise that share them, "0.05 0.1 0.15 0.2" unless named
#   --updates U       to learn with, 12000 unless named
#   --goals N         to ride to before and after, the same ones, 10 unless named
#   --seed S          of goals, noise and learning, 1 unless named
#   --output FOLDER   where everything goes; runs/record-and-learn-<date> of the workspace unless named
#
# All rides are in lock-step, as fast as this machine can. The comparison is over the same 1,000 random
# pairs of start and goal in simulation, and over the same goals ridden by the nodes.
# Exit status: 0 the new policy is better, 5 it is not, 2 bad arguments, 1 anything else, 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
policy=lqr minutes=60 sigmas="0.05 0.1 0.15 0.2" updates=12000 goals=10 seed=1 folder=
while (($#)); do
  (($# > 1)) || die 2 "$1 needs a value; see record_and_learn.sh --help."
  case $1 in
    --policy) policy=$2 ;;
    --minutes) minutes=$2 ;;
    --sigmas) sigmas=$2 ;;
    --updates) updates=$2 ;;
    --goals) goals=$2 ;;
    --seed) seed=$2 ;;
    --output)
      folder=$2
      [[ -n $folder ]] || die 2 "--output is empty: name a folder."
      ;;
    *) die 2 "unknown option '$1'; see record_and_learn.sh --help." ;;
  esac
  shift 2
done
number='^[0-9]{1,6}(\.[0-9]{1,9})?$' whole='^[0-9]{1,9}$' above='[1-9]'
[[ -n $policy ]] || die 2 "--policy is empty: name a policy."
[[ $minutes =~ $number && $minutes =~ $above ]] || die 2 "--minutes is '$minutes': give a number above 0."
for name in updates goals seed; do
  [[ ${!name} =~ $whole ]] || die 2 "--$name is '${!name}': give a whole number."
  [[ $name == seed || ${!name} =~ $above ]] || die 2 "--$name is '${!name}': give 1 or more."
done
IFS=$' \t' read -ra sizes <<<"${sigmas//[[:cntrl:]]/ }"
((${#sizes[@]})) || die 2 "--sigmas is '$sigmas': give numbers."
for sigma in "${sizes[@]}"; do
  [[ $sigma =~ $number ]] || die 2 "--sigmas holds '$sigma': give numbers."
done
folder=${folder:-$ws/runs/record-and-learn-$(date +%Y-%m-%d-%H%M%S)}
[[ ! -e $folder && ! -L $folder ]] || die 2 "$folder is there already; name another --output."

"$ws/setup.sh" --quiet
enter_workspace
"$python" -c 'import importlib.util, sys; sys.exit(importlib.util.find_spec("torch") is None)' ||
  die 1 "learning needs torch; run $ws/setup.sh --with train."
mkdir -p "$folder"

ride() { # FOLDER ARGUMENT...: a ride in lock-step; falls and missed goals are data too
  local status=0
  "$ws/ride.sh" --output "$@" simulator.pace:=lockstep || status=$?
  case $status in 0 | 3 | 4) ;; *) exit "$status" ;; esac
}

echo "== 1 of 5: before: $policy rides to $goals goals"
ride "$folder/before" --goals "$goals" --seed "$seed" "controller.policy:=$policy"

each=$(awk "BEGIN { print $minutes / ${#sizes[@]} }")
echo "== 2 of 5: $policy rides and explores, $each minutes each with noise of ${sizes[*]}"
for sigma in "${sizes[@]}"; do
  ride "$folder/rides/$sigma" --minutes "$each" --seed "$((seed + 1))" "controller.policy:=$policy" \
    controller.exploration:=ou "controller.exploration_sigma:=$sigma" "controller.seed:=$seed"
done

echo "== 3 of 5: learning from these bags alone"
bicycle learn "$folder/rides" --out "$folder/learned" --seed "$seed" --updates "$updates"
new=$folder/learned/best.safetensors

echo "== 4 of 5: after: the new policy rides to the same goals"
ride "$folder/after" --goals "$goals" --seed "$seed" "controller.policy:=$new"

echo "== 5 of 5: before against after"
bicycle evaluate "$new" --against "$policy" --episodes 1000 --seed "$seed" --json >"$folder/comparison.json"
status=0
"$python" -m bicycle_tools.record_and_learn "$folder" | tee "$folder/summary.txt" || status=${PIPESTATUS[0]}
exit "$status"
