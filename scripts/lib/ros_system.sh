# A ROS system of its own beside any other on this machine; sourced after source_devel. It ends with the script.

ros_pids=()

# start_ros DIR: a master on a free port; its logs go to DIR.
start_ros() {
  export ROS_HOSTNAME=localhost ROS_HOME=$1/ros_home
  local port
  port=$(/usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("", 0)); print(s.getsockname()[1])')
  export ROS_MASTER_URI=http://localhost:$port
  trap stop_ros EXIT
  trap 'exit 130' INT
  trap 'exit 143' TERM
  setsid roscore -p "$port" >"$1/roscore.log" 2>&1 &
  ros_pids+=($!)
  local _
  for _ in $(seq 100); do
    if rosparam get /run_id >/dev/null 2>&1; then return; fi
    sleep 0.2
  done
  fail "no ROS master came up; see $1/roscore.log"
}

# launch_nodes DIR FILE.launch [ARGUMENTS...]: in the background; output to DIR/roslaunch.log.
launch_nodes() {
  local dir=$1
  shift
  setsid roslaunch --sigint-timeout 5 autocal_vio "$@" >"$dir/roslaunch.log" 2>&1 &
  ros_pids+=($!)
}

# Ends what was started, the last first: asks, waits, then insists.
stop_ros() {
  local i pid
  for ((i = ${#ros_pids[@]} - 1; i >= 0; i--)); do
    pid=${ros_pids[i]}
    kill -INT "$pid" 2>/dev/null || continue
    for _ in $(seq 200); do
      kill -0 "$pid" 2>/dev/null || break
      sleep 0.1
    done
    kill -KILL -- "-$pid" 2>/dev/null || true
  done
  ros_pids=()
}
