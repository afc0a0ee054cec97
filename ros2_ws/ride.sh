#!/usr/bin/env bash
# Rides the bicycle to random goals and records it: set-up, simulator, controller, recorder, summary.
#
# Usage: ride.sh [--goals N | --minutes M | --course NAME|FILE [--laps N] [--speed M_S]] [--seed S] [--field METRES] [--output FOLDER]
#                [--no-respawn] [--hardware-in-the-loop] [NODE.name:=value]... [parameters.yaml]...
#
#   --goals N         goals to ride to, 10 unless named
#   --minutes M       ride for M minutes of simulated time instead
#   --course NAME     follow a course instead of riding to goals, such as slalom, figure-eight, road, or a
#                     YAML, CSV or GPX file; docs/paths.md lists them. The scenario is then learned-speed
#                     and the policy lqr-pedal, unless named
#   --laps N, --speed M_S   of the course, its own unless named
#   --seed S          of goals and start, 0 unless named: the same seed gives the same goals
#   --field METRES    side of the square around the start that goals lie in, 60 unless named
#   --output FOLDER   where the run goes; runs/<date>-<n> of the workspace unless named
#   --no-respawn      end the ride when the controller dies, instead of starting it again
#   --hardware-in-the-loop  ride from sensors only, through a simulated microcontroller: the firmware as a
#                     program of its own, on a pseudo-terminal, with the driver that a real one would have.
#                     The bicycle is a measured one, browser-rider, and the policy the LQR, unless named;
#                     docs/real-bicycle.md says more
#   NODE.name:=value  a parameter of simulator, controller or, with the option above, driver, such as
#                     controller.policy:=lqr
#
# The first call sets everything up, which takes some minutes; later calls ride at once.
# The run's folder then holds bag/, ride.png, summary.json and the nodes' logs.
# Ctrl-C ends the ride, with the summary of what was ridden.
# Exit status: 0 every goal reached without a fall, 3 fallen, 4 a goal not reached,
# 1 a part failed, 2 bad arguments, 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
"$ws/setup.sh" --quiet
enter_workspace
run ride bicycle_bringup.nodes.ride "$@"
