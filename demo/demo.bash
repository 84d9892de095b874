# The demos of ./teletact, which reads this file: the processes of the whole system on this machine, their faults, a
# summary. Uses BUILD, say, die, die_of_usage, build and choose_kernel_cache of it.

demo_usage() {
  cat <<'TEXT'
usage: ./teletact demo [--out DIR] [--seed N | --tissue FILE] [--surface KIND] [--duration-s S] [--round-trip-ms T]
       ./teletact demo --plane [--out DIR] [--seed N] [--duration-s S] [--round-trip-ms T] [--passes N]
       ./teletact demo --page [--out DIR] [--seed N] [--duration-s S] [--passes N] [--port N]
       ./teletact demo --solid-given [--out DIR] [--seed N] [--duration-s S] [--round-trip-ms T]

A solid patient with three hidden lumps: nine slices 5 mm apart are imaged while a finger goes in circles across them at
40 mm/s; its forces beside those of the patient's own tissue, and the lumps that were found.

  --out DIR       where summary.json, pictures, recordings and logs go (demo-out); those of an earlier run go away
  --seed N        which patient: where its hidden inclusions lie (1)
  --tissue FILE   instead: a solid of your own, a file as `patient --save-tissue` writes it
  --surface KIND  what is stated of its surface: unknown, bare or uneven (unknown)
  --duration-s S  how long the finger explores, above 0 (20; with --plane 12, --page 60)
  --round-trip-ms T
                  so long a link between the operator and the service, 0 to 9999 (0: none is added)
  --plane         instead: the paper's plane. A finger sweeps over 300 mm of tissue at 120 mm/s while a probe images
                  ahead of it
  --passes N      of --plane and --page: acquisitions of each window that are simulated before the clock starts
                  (one per 2 s)
  --page          the plane on a live page, at the address that is printed; its buttons make the link, the service
                  and the probe fail. The finger explores for 60 s; then the page stays until Ctrl-C
  --port N        of the page (0: a free one)
  --solid-given   instead: a solid patient of three layers and two lumps whose modulus is given slice by slice,
                  felt in circles by a finger at 20 mm/s; its forces beside those of the patient's own
                  tissue, and beside a plane model's; tactile images. Minutes on a busy machine
TEXT
}

demo() {
  local out=demo-out seed=1 seeded= duration= round_trip=0 passes= which=slices port=0 tissue= surface=unknown
  while (($#)); do
    case $1 in
      --out | --seed | --tissue | --surface | --duration-s | --round-trip-ms | --passes | --port)
        (($# >= 2)) || die_of_usage "$1 needs a value"
        case $1 in
          --out) out=$2 ;;
          --seed) seed=$2 seeded=1 ;;
          --tissue) tissue=$2 ;;
          --surface) surface=$2 ;;
          --duration-s) duration=$2 ;;
          --round-trip-ms) round_trip=$2 ;;
          --passes) passes=$2 ;;
          --port) port=$2 ;;
        esac
        shift 2
        ;;
      --plane | --page | --solid-given)
        [[ $which == slices || $which == "${1#--}" ]] || die_of_usage "--$which and $1 are two demos: leave one out"
        which=${1#--}
        shift
        ;;
      --solid) die_of_usage "--solid: no longer an option; ./teletact demo is solid without it" ;;
      -h | --help) demo_usage; return 0 ;;
      *) demo_usage >&2; die_of_usage "unknown argument of demo: $1" ;;
    esac
  done
  if [[ -z $duration ]]; then
    case $which in plane) duration=12 ;; page) duration=60 ;; *) duration=20 ;; esac
  fi
  [[ -z $passes || $which == plane || $which == page ]] ||
    die_of_usage "--passes: only --plane and --page acquire a window again; leave it out"
  [[ -z $tissue && $surface == unknown || $which == slices ]] ||
    die_of_usage "--tissue, --surface: of the demo without --$which; leave them out"
  [[ $surface =~ ^(unknown|bare|uneven)$ ]] || die_of_usage "--surface: unknown, bare or uneven, not '$surface'"
  [[ -z $tissue || -f $tissue && -r $tissue ]] || die_of_usage "--tissue: cannot read '$tissue'"
  [[ $which != page || $round_trip == 0 ]] || die_of_usage "--round-trip-ms: the page has a button for it; leave it out"
  [[ -z $seeded || -z $tissue ]] || die_of_usage "--seed and --tissue are two patients: leave one out"
  [[ $port =~ ^[0-9]{1,5}$ ]] || die_of_usage "--port must be 0 to 65535, not '$port'"
  [[ $seed =~ ^[0-9]+$ ]] || die_of_usage "--seed must be a whole number, not '$seed'"
  [[ $duration =~ ^[0-9]+(\.[0-9]+)?$ && $duration =~ [1-9] ]] ||
    die_of_usage "--duration-s must be a number above 0, not '$duration'"
  [[ $round_trip =~ ^[0-9]{1,4}(\.[0-9]+)?$ ]] || die_of_usage "--round-trip-ms must be 0 to 9999, not '$round_trip'"
  # A sweep takes 2.4 s and asks for each window once: enough passes that none runs out of fresh ones.
  [[ -n $passes ]] || passes=$((10#${duration%.*} / 2 + 1))
  [[ $passes =~ ^[1-9][0-9]*$ ]] || die_of_usage "--passes must be a whole number above 0, not '$passes'"
  mkdir -p -- "$out" 2>/dev/null && [[ -w $out ]] || die "cannot write the output folder $out: give another with --out"
  out=$(cd -- "$out" && pwd)
  hold_folder "$out"
  [[ ! $tissue -ef $out/patient.toml ]] || die "--tissue: $tissue would be written over: give another folder with --out"
  [[ $round_trip =~ [1-9] ]] || round_trip=
  case $which in
    plane) build teletact-service compiled_kernels teletact-client ${round_trip:+teletact-proxy} ;;
    page) build teletact-service compiled_kernels teletact-client teletact-proxy ;;
    *) build teletact-service compiled_kernels teletact-client teletact-felt ${round_trip:+teletact-proxy} ;;
  esac
  choose_kernel_cache
  begin_demo "$out" "$which"
  case $which in
    plane) run_plane_demo "$seed" "$duration" "$passes" "$round_trip" ;;
    page) run_page_demo "$seed" "$duration" "$passes" "$port" ;;
    slices) run_slices_demo "$seed" "$tissue" "$surface" "$duration" "$round_trip" ;;
    *) run_given_demo "$seed" "$duration" "$round_trip" ;;
  esac
}

# Of two demos in one folder the first would judge its touch against the other's patient: the second ends here. The
# lock is on log, for the folder itself is held by the report; where there is no flock, or none on that file system,
# nothing is held.
hold_folder() {
  mkdir -p -- "$1/log" 2>/dev/null || die "cannot write the output folder $1: give another with --out"
  command -v flock >/dev/null || return 0
  exec {DEMO_LOCK}<"$1/log"
  local status=0
  flock --nonblock --conflict-exit-code 75 "$DEMO_LOCK" 2>/dev/null || status=$?
  ((status != 75)) || die "another demo writes into $1: give another folder with --out"
}

DEMO_PIDS=()
DEMO_RUN=
DEMO_OUT=
DEMO_BEGIN_M=0.01  # the finger sweeps between these: the tip's reach of 8 mm stays on the 300 mm of tissue
DEMO_END_M=0.29

# Ends what the demo has started, gently first; called on every way out.
end_demo() {
  local pid
  trap - INT TERM EXIT
  for pid in "${DEMO_PIDS[@]}"; do kill -TERM "$pid" 2>/dev/null || true; done
  for pid in "${DEMO_PIDS[@]}"; do
    for _ in {1..50}; do kill -0 "$pid" 2>/dev/null || break; sleep 0.1; done
    kill -KILL "$pid" 2>/dev/null || true
    wait "$pid" 2>/dev/null || true
  done
  DEMO_PIDS=()
  if [[ -n $DEMO_RUN ]]; then rm -rf -- "$DEMO_RUN"; fi
}

fail_demo() {
  local log
  printf 'teletact: %s\n' "$1" >&2
  for log in service acquire slices proxy touch page report; do
    [[ -s $DEMO_OUT/log/$log.log ]] || continue
    printf -- '-- the end of %s\n' "$DEMO_OUT/log/$log.log" >&2
    tail -n 15 "$DEMO_OUT/log/$log.log" >&2
  done
  end_demo
  exit 1
}

# Ctrl-C is how a demo is stopped: nothing went wrong that logs could tell. $1: the exit status.
interrupt_demo() {
  end_demo
  printf 'teletact: interrupted\n' >&2
  exit "$1"
}

# Waits until `$1...` succeeds while process DEMO_WAIT_PID lives, at most DEMO_WAIT_S seconds; shows each new
# last line of DEMO_WAIT_LOG meanwhile.
await() {
  local line shown=
  local end=$((SECONDS + DEMO_WAIT_S))
  until "$@"; do
    kill -0 "$DEMO_WAIT_PID" 2>/dev/null || fail_demo "$DEMO_WAIT_WHAT ended before it was ready"
    ((SECONDS < end)) || fail_demo "$DEMO_WAIT_WHAT was not ready within $DEMO_WAIT_S s"
    line=$(tail -n 1 "$DEMO_WAIT_LOG" 2>/dev/null | tr -d '\r' || true)
    if [[ -n $line && $line != "$shown" ]]; then
      shown=$line
      printf '   %s\n' "$line" >&2
    fi
    sleep 0.2
  done
}

# Starts a process of the demo in the background: log name, then the command.
start() {
  DEMO_WAIT_LOG=$DEMO_OUT/log/$1.log
  shift
  "$@" >"$DEMO_WAIT_LOG" 2>&1 &
  DEMO_WAIT_PID=$!
  DEMO_PIDS+=("$DEMO_WAIT_PID")
}

DEMO_CLIENT=$BUILD/client/teletact-client
DEMO_SERVICE_PID=

# The folder, and a service at unix:$DEMO_RUN/s.
begin_demo() {
  DEMO_OUT=$1
  DEMO_RUN=$(mktemp -d "${TMPDIR:-/tmp}/tt.XXXXXX")  # short: a socket's path may have 107 bytes
  mkdir -p "$DEMO_OUT/log"
  # What an earlier run wrote, by name: a run that is interrupted must not leave two patients' files side by side.
  rm -f -- "$DEMO_OUT"/{summary.json,{modulus,force,latency,periods,tactile}.png,{touch,acquire}.record,patient.toml,modulus.mha,log-std.mha} \
    "$DEMO_OUT"/log/{service,acquire,slices,proxy,touch,page,report}.log
  trap 'interrupt_demo 130' INT
  trap 'interrupt_demo 143' TERM
  trap 'end_demo' EXIT
  say "writing into $DEMO_OUT"
  say "1/4 service"
  start_service "$2"
  DEMO_WAIT_WHAT="the service" DEMO_WAIT_S=300
  await grep -qs "serving on" "$DEMO_OUT/log/service.log"
}

# One that may be killed (`page`) keeps its scenes.
start_service() {
  local state=()
  [[ $1 != page ]] || state=(--state "$DEMO_RUN/state")
  start service "$BUILD/service/teletact-service" serve --listen "unix:$DEMO_RUN/s" "${state[@]}"
  DEMO_SERVICE_PID=$DEMO_WAIT_PID
}

# Touches the scene `demo` as $1 ms of round trip away ("": here), recorded; then the options of touch.
touch_demo() {
  local round_trip=$1 touched_at=unix:$DEMO_RUN/s
  shift
  if [[ -n $round_trip ]]; then
    start proxy "$BUILD/bench/teletact-proxy" --service "$touched_at" --round-trip-ms "$round_trip"
    DEMO_WAIT_WHAT="the link" DEMO_WAIT_S=10
    await grep -qs "passing on at" "$DEMO_OUT/log/proxy.log"
    touched_at=$(sed -n 's/^passing on at //p' "$DEMO_OUT/log/proxy.log")
  fi
  start touch "$DEMO_CLIENT" touch --service "$touched_at" --scene demo --device simulated \
    --record "$DEMO_OUT/touch.record" "$@"
  wait "$DEMO_WAIT_PID" || fail_demo "the operator side failed"
  kill -0 "$DEMO_SERVICE_PID" 2>/dev/null || fail_demo "the service died"
}

# Ends the demo as its report did, with exit status $1.
report_demo() {
  end_demo
  say "summary and pictures are in $DEMO_OUT"
  case $1 in
    0) ;;
    2) die "the demo ran, but missed what is marked NOT MET above" ;;
    *) fail_demo "the report failed" ;;
  esac
}

run_plane_demo() {
  local seed=$1 duration=$2 passes=$3 round_trip=$4 status=0
  say "2/4 patient side: simulating RF of patient $seed"
  start acquire "$DEMO_CLIENT" acquire --service "unix:$DEMO_RUN/s" --scene demo --seed "$seed" \
    --passes-prepared "$passes" --save-tissue "$DEMO_OUT/patient.toml" --record "$DEMO_OUT/acquire.record" \
    --ready-file "$DEMO_RUN/acquire.ready" --start-x-m "$DEMO_BEGIN_M" --until-finger-leaves
  local acquire_pid=$DEMO_WAIT_PID
  DEMO_WAIT_WHAT="the patient side" DEMO_WAIT_S=600
  await test -e "$DEMO_RUN/acquire.ready"
  say "3/4 operator side: a finger explores for $duration s at 120 mm/s${round_trip:+, $round_trip ms of round trip away}"
  touch_demo "$round_trip" --duration-s "$duration" --begin-m "$DEMO_BEGIN_M" --end-m "$DEMO_END_M"
  wait "$acquire_pid" || fail_demo "the patient side failed"
  say "4/4 report"
  "$DEMO_CLIENT" report --tissue "$DEMO_OUT/patient.toml" --touch-record "$DEMO_OUT/touch.record" \
    --acquire-record "$DEMO_OUT/acquire.record" --out "$DEMO_OUT" 2>"$DEMO_OUT/log/report.log" || status=$?
  report_demo "$status"
}

# What a button of the page asks for.
fault() {
  say "the page asks for: $1"
  case $1 in
    kill)
      kill -KILL "$DEMO_SERVICE_PID" 2>/dev/null || true
      wait "$DEMO_SERVICE_PID" 2>/dev/null || true
      rm -f -- "$DEMO_RUN/s"
      start_service page
      ;;
    force | decorrelated) printf '%s\n' "$1" >&7 ;;
    *) printf '%s\n' "$1" >&8 ;;
  esac
}

# The operator's link and the probe can be made to fail: through pipes that the proxy and the patient side read.
run_page_demo() {
  local seed=$1 duration=$2 passes=$3 port=$4 status=0 word
  mkfifo -m 600 "$DEMO_RUN"/{probe,link,faults}
  exec 7<>"$DEMO_RUN/probe" 8<>"$DEMO_RUN/link" 9<>"$DEMO_RUN/faults"
  start page "$DEMO_CLIENT" watch --session "$DEMO_OUT/touch.record" --acquire "$DEMO_OUT/acquire.record" --service "unix:$DEMO_RUN/s" \
    --scene demo --faults "$DEMO_RUN/faults" --port "$port"
  DEMO_WAIT_WHAT="the page" DEMO_WAIT_S=20
  await grep -qs "the page is at" "$DEMO_OUT/log/page.log"
  say "$(grep "the page is at" "$DEMO_OUT/log/page.log")"
  say "2/4 patient side: simulating RF of patient $seed"
  start acquire "$DEMO_CLIENT" acquire --service "unix:$DEMO_RUN/s" --scene demo --seed "$seed" \
    --passes-prepared "$passes" --save-tissue "$DEMO_OUT/patient.toml" --record "$DEMO_OUT/acquire.record" \
    --ready-file "$DEMO_RUN/acquire.ready" --start-x-m "$DEMO_BEGIN_M" --spoil "$DEMO_RUN/probe"
  local acquire_pid=$DEMO_WAIT_PID
  DEMO_WAIT_WHAT="the patient side" DEMO_WAIT_S=600
  await test -e "$DEMO_RUN/acquire.ready"
  start proxy "$BUILD/bench/teletact-proxy" --service "unix:$DEMO_RUN/s" --control "$DEMO_RUN/link"
  DEMO_WAIT_WHAT="the link" DEMO_WAIT_S=10
  await grep -qs "passing on at" "$DEMO_OUT/log/proxy.log"
  say "3/4 operator side: a finger explores for $duration s at 120 mm/s"
  start touch "$DEMO_CLIENT" touch --service "$(sed -n 's/^passing on at //p' "$DEMO_OUT/log/proxy.log")" --scene demo \
    --device simulated --record "$DEMO_OUT/touch.record" --json "$DEMO_OUT/summary.json" --force \
    --duration-s "$duration" --begin-m "$DEMO_BEGIN_M" --end-m "$DEMO_END_M"
  local touch_pid=$DEMO_WAIT_PID
  while kill -0 "$touch_pid" 2>/dev/null; do
    if read -r -t 0.2 -u 9 word; then fault "$word"; fi
  done
  wait "$touch_pid" || fail_demo "the operator side failed"
  # Told to end: a finger that a fault takes away for a while has not left.
  kill -INT "$acquire_pid" 2>/dev/null || true
  wait "$acquire_pid" || say "the patient side had failed: $(tail -n 1 "$DEMO_OUT/log/acquire.log")"
  say "4/4 it is over; what was felt stays on the page until Ctrl-C. Again: ./teletact watch --recording $DEMO_OUT/touch.record --recording $DEMO_OUT/acquire.record"
  trap 'end_demo; exit 0' INT TERM
  while sleep 1; do :; done
}

# Until a solid has been felt once: what touch needs is compiled by then. The options of touch.
first_touch() {
  start touch "$DEMO_CLIENT" touch --service "unix:$DEMO_RUN/s" --scene demo --device simulated --tactile "$@"
  DEMO_WAIT_WHAT="a first touch" DEMO_WAIT_S=300
  await grep -qs "beyond homogeneous" "$DEMO_OUT/log/touch.log"
  kill -INT "$DEMO_WAIT_PID"
  wait "$DEMO_WAIT_PID" || fail_demo "the first touch failed"
}

run_given_demo() {
  local seed=$1 duration=$2 round_trip=$3 status=0
  local touch=(--indentation-m 0.002 --circle-radius-m 0.008 --begin-m 0.025 --end-m 0.087 --speed-m-s 0.02)
  say "2/4 patient side: the modulus of solid patient $seed, slice by slice; a first touch compiles what touch needs"
  start slices "$DEMO_CLIENT" slices --service "unix:$DEMO_RUN/s" --scene demo --seed "$seed" --every-s 0.1
  wait "$DEMO_WAIT_PID" || fail_demo "the patient side failed"
  tail -n 1 "$DEMO_OUT/log/slices.log" | sed 's/^/   /' >&2
  first_touch "${touch[@]}"
  say "3/4 operator side: a finger goes in circles for $duration s at 20 mm/s${round_trip:+, $round_trip ms of round trip away}"
  touch_demo "$round_trip" --duration-s "$duration" --tactile "${touch[@]}"
  say "4/4 the patient's own tissue at 48 of the poses that were felt: about a minute"
  "$BUILD/bench/teletact-felt" --touch-record "$DEMO_OUT/touch.record" --seed "$seed" --poses 48 \
    --out "$DEMO_OUT" 2>"$DEMO_OUT/log/report.log" || status=$?
  report_demo "$status"
}

# The patient side's nine slices, or all that it could take: it has ended.
all_slices() {
  (($(grep -c "can be touched" "$DEMO_OUT/log/acquire.log") == 9)) || ! kill -0 "$1" 2>/dev/null
}

# The slices are taken from z = -20 to 20 mm; fingers begin when five of them are there: at 40 mm/s circles advance by
# 6.4 mm/s. The probe's face is stated to 0.3 mm, as a calliper tells it. The patient side ends with the touch: no
# finger would feel the corrections that it still holds back.
run_slices_demo() {
  local seed=$1 tissue=$2 surface=$3 duration=$4 round_trip=$5 status=0 patient=(--seed "$1")
  [[ -z $tissue ]] || patient=(--tissue "$tissue")
  local touch=(--indentation-m 0.002 --along z --across-m 0.030 --circle-radius-m 0.008 --begin-m -0.012 --end-m 0.012
    --speed-m-s 0.04)
  say "2/4 patient side: pressing the probe of solid patient ${tissue:-$seed} at nine places, and simulating its RF"
  start acquire "$DEMO_CLIENT" acquire --service "unix:$DEMO_RUN/s" --scene demo "${patient[@]}" --surface "$surface" \
    --slices 9 --slice-pitch-m 0.005 --lookahead 4 --passes-prepared 2 --probe-elevation-std-m 0.0003 \
    --save-tissue "$DEMO_OUT/patient.toml" \
    --save-modulus "$DEMO_OUT/modulus.mha" --save-log-std "$DEMO_OUT/log-std.mha" \
    --record "$DEMO_OUT/acquire.record" --ready-file "$DEMO_RUN/acquire.ready"
  local acquire_pid=$DEMO_WAIT_PID
  DEMO_WAIT_WHAT="the patient side" DEMO_WAIT_S=1200
  await test -e "$DEMO_RUN/acquire.ready"
  first_touch "${touch[@]}"
  say "3/4 operator side: a finger goes in circles across the slices for $duration s at 40 mm/s${round_trip:+, $round_trip ms of round trip away}"
  touch_demo "$round_trip" --duration-s "$duration" "${touch[@]}"
  DEMO_WAIT_PID=$acquire_pid DEMO_WAIT_WHAT="the patient side" DEMO_WAIT_S=60
  await all_slices "$acquire_pid"
  kill -INT "$acquire_pid" 2>/dev/null || true
  wait "$acquire_pid" || fail_demo "the patient side failed"
  say "4/4 the patient's own tissue at 40 of the poses that were felt: about half a minute"
  "$BUILD/bench/teletact-felt" --touch-record "$DEMO_OUT/touch.record" --poses 40 \
    --tissue "$DEMO_OUT/patient.toml" --modulus "$DEMO_OUT/modulus.mha" \
    --log-std "$DEMO_OUT/log-std.mha" --acquire-record "$DEMO_OUT/acquire.record" --out "$DEMO_OUT" \
    2>"$DEMO_OUT/log/report.log" || status=$?
  report_demo "$status"
}
