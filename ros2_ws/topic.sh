#!/usr/bin/env bash
# Looks at topics and publishes on them, as ros2 topic does, which the wheels lack.
#
# Usage: topic.sh list
#        topic.sh info TOPIC
#        topic.sh type TOPIC
#        topic.sh echo TOPIC [--once] [--field NAME]
#        topic.sh rate|hz TOPIC [--seconds S]
#        topic.sh pub TOPIC [TYPE] [VALUES] [--once | --times N] [--rate HZ] [OPTION]...
#
#   TYPE             as geometry_msgs/msg/PoseStamped; not needed where the topic is there already
#   VALUES           of the message, as YAML; what is left out keeps its default
#   -1, --once       one message, when somebody subscribes
#   -t, --times N    so many; without one of the two, until Ctrl-C
#   -r, --rate HZ    1 unless named
#   -w, --wait-matching-subscriptions N   subscribers to wait for, 3 s at most
#   --qos-reliability reliable|best_effort, --qos-durability volatile|transient_local
#
# Examples: topic.sh echo /bicycle/state --once --field rear_contact
#           topic.sh pub --once goal_pose '{header: {frame_id: odom}, pose: {position: {x: 20.0}}}'
#
# A name without a slash in front is in the namespace of __ns:=/name, or in /.
# Exit status: 0, 1 no such topic, no message or no subscriber, 2 bad arguments.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
run topic bicycle_tools.nodes.topic "$@"
