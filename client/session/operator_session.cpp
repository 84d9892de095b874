#include "client/session/operator_session.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <thread>

#include "client/clock/clock.h"
#include "client/link/channel.h"
#include "client/link/scenes.h"
#include "client/link/servo_messages.h"
#include "client/render/renderers.h"
#include "client/session/adapter_watch.h"
#include "client/session/figures.h"
#include "client/session/real_device.h"
#include "client/session/recorded_log.h"
#include "client/session/tick_log.h"
#include "client/session/waiting.h"

namespace teletact::client {
namespace {

using Seconds = std::chrono::duration<double>;

constexpr double kDrainS = 0.01;   // between looks at the servo's ticks
constexpr double kFiguresS = 0.5;  // between what is recorded of the figures so far

// The scene with something to touch, waited for up to `wait_s`.
v1::Scene wait_for_scene(const OperatorSessionOptions& options, const std::atomic<bool>& stop) {
  const double connect_s = std::max(options.wait_s, options.connect_s);
  const auto deadline = std::chrono::steady_clock::now() + Seconds(connect_s);
  const auto channel = make_channel(options.address, options.credentials);
  constexpr double kTryS = 0.2;
  bool connected = false;
  while (!stop && !connected && std::chrono::steady_clock::now() < deadline) {
    connected = wait_connected(*channel, kTryS);
  }
  if (!connected) {
    throw std::runtime_error(nobody_answers(options.address, options.credentials));
  }
  const auto stub = v1::Palpation::NewStub(channel);
  const auto scene_deadline = std::chrono::steady_clock::now() + Seconds(options.wait_s);
  while (true) {
    v1::Scene scene;
    const grpc::Status status =
        get_scene(*stub, options.open.scene_id(), v1::SCENE_VIEW_BASIC, scene, std::chrono::seconds(5));
    if (status.ok() && touchable_extent(scene)) return scene;
    const bool kept_out = status.error_code() == grpc::StatusCode::UNAUTHENTICATED ||
                          status.error_code() == grpc::StatusCode::PERMISSION_DENIED;
    if (stop || kept_out || std::chrono::steady_clock::now() >= scene_deadline) {
      if (status.ok()) {
        throw std::runtime_error("scene '" + options.open.scene_id() +
                                 "' has no window to touch yet; acquire one, or wait for it with --wait-s");
      }
      throw std::runtime_error("cannot touch scene '" + options.open.scene_id() + "': " + describe(status));
    }
    std::this_thread::sleep_for(Seconds(kTryS / 2));
  }
}

double width_of(const v1::Scene& scene) {
  return scene.geometry().size_m_size() > 0 ? scene.geometry().size_m(0) : 0;
}

// A sweep beyond the tissue would never end.
void require_within(const v1::Scene& scene, const char* option, const std::optional<double>& at_m,
                    bool along_z = false) {
  const ExtentZ z = touchable_extent_z(scene).value_or(ExtentZ{});
  const double begin_m = along_z ? z.begin_z_m : 0, end_m = along_z ? z.end_z_m : width_of(scene);
  if (!at_m || end_m == begin_m) return;
  if (*at_m >= begin_m && *at_m <= end_m) return;
  throw std::invalid_argument(fmt::format("{} {}: the tissue of scene '{}' reaches from {} to {} m{}", option,
                                          *at_m, scene.scene_id(), begin_m, end_m,
                                          along_z ? " along z" : ""));
}

// How far from its middle a tip touches: as it is given, else what the service takes.
double reach_of(const v1::Fingertip& tip) {
  constexpr double kUsualM = 0.008;
  const double given_m = tip.radius_m() + tip.half_width_m();
  return given_m > 0 ? given_m : kUsualM;
}

// The place nearest to `wish_m` at which the whole tip is over windows that can be touched.
double touchable_near(const v1::Scene& scene, double wish_m, double reach_m) {
  double nearest_m = wish_m, distance_m = 1e300;
  for (const Extent& extent : touchable_extents(scene)) {
    const double inside_m = std::min(reach_m, (extent.end_x_m - extent.begin_x_m) / 2);
    const double x_m = std::clamp(wish_m, extent.begin_x_m + inside_m, extent.end_x_m - inside_m);
    if (std::abs(x_m - wish_m) >= distance_m) continue;
    distance_m = std::abs(x_m - wish_m);
    nearest_m = x_m;
  }
  return nearest_m;
}

// Where a person's hand begins: with tissue to both sides of it.
double start_of_real_device(const v1::Scene& scene, const std::optional<double>& asked_m, double reach_m) {
  require_within(scene, "--start-x-m", asked_m);
  const Extent extent = touchable_extent(scene).value();
  const std::vector<Extent> extents = touchable_extents(scene);
  const bool covered = std::any_of(extents.begin(), extents.end(), [&](const Extent& e) {
    return asked_m && *asked_m >= e.begin_x_m && *asked_m <= e.end_x_m;
  });
  const double start_m =
      asked_m ? *asked_m : touchable_near(scene, (extent.begin_x_m + extent.end_x_m) / 2, reach_m);
  if (asked_m && !covered)
    spdlog::warn("--start-x-m {}: no window covers it yet, so nothing is felt there; {:.3f} m can be touched",
                 start_m, touchable_near(scene, start_m, reach_m));
  return start_m;
}

HandOptions hand_on(const v1::Scene& scene, const OperatorSessionOptions& options) {
  const std::optional<ExtentZ> z = touchable_extent_z(scene);
  const double reach_m = reach_of(options.open.fingertip());
  const double middle_z_m = z ? (z->begin_z_m + z->end_z_m) / 2 : 0;
  if (is_real(options.device)) {
    HandOptions hand;
    hand.start_m = start_of_real_device(scene, options.start_x_m, reach_m);
    hand.across_m = middle_z_m;
    return hand;
  }
  HandOptions hand = options.hand;
  if (hand.along_z && !z)
    throw std::invalid_argument(
        fmt::format("--along z: scene '{}' is the same for every z; leave it out", scene.scene_id()));
  require_within(scene, "--begin-m", options.begin_m, hand.along_z);
  require_within(scene, "--end-m", options.end_m, hand.along_z);
  require_within(scene, "--across-m", options.across_m, !hand.along_z);
  const Extent extent = touchable_extent(scene).value();
  const double inside_m = reach_m + hand.circle_radius_m;
  hand.begin_m = options.begin_m.value_or((hand.along_z ? z->begin_z_m : extent.begin_x_m) + inside_m);
  hand.end_m = options.end_m.value_or((hand.along_z ? z->end_z_m : extent.end_x_m) - inside_m);
  hand.across_m =
      options.across_m.value_or(hand.along_z ? (extent.begin_x_m + extent.end_x_m) / 2 : middle_z_m);
  if (!(hand.end_m > hand.begin_m)) {
    throw std::invalid_argument(
        fmt::format("the sweep ends ({:.4f} m) before it begins ({:.4f} m), the tip's reach of {:.4g} m "
                    "within the tissue; "
                    "set --begin-m and --end-m, or a smaller --tip-radius-m",
                    hand.end_m, hand.begin_m, reach_m));
  }
  // The first press is where something can be touched already: at the beginning, or as near to it as can be.
  hand.start_m = hand.along_z ? hand.begin_m : touchable_near(scene, hand.begin_m, reach_m);
  return hand;
}

v1::RecordHeader header_of(const OperatorSessionOptions& options) {
  v1::RecordHeader header;
  header.set_kind("touch");
  header.set_client("teletact-client");
  header.set_service(options.address);
  header.set_scene_id(options.open.scene_id());
  header.set_unix_time_s(
      std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch())
          .count());
  for (const std::string& argument : options.arguments) header.add_arguments(argument);
  return header;
}

// Where the session goes: into a file, or nowhere.
struct Kept {
  explicit Kept(const OperatorSessionOptions& options) {
    if (options.record_path.empty()) return;
    recorder = std::make_unique<RecordWriter>(options.record_path, header_of(options));
    log = std::make_unique<RecordedLog>(*recorder);
  }
  void append(const TouchSummary& summary, std::int64_t now_ns) {
    if (recorder) recorder->append(to_record(summary, now_ns));
  }

  std::unique_ptr<RecordWriter> recorder;
  std::unique_ptr<RecordedLog> log;
};

// Empties the servo's telemetry into the statistics, the log and the recording.
void drain(ServoLoop& servo, TickStatistics& statistics, TickLog& log, RecordWriter* recorder) {
  ServoTick tick;
  while (servo.telemetry().pop(tick)) {
    statistics.add(tick);
    for (const LogMessage& message : log.add(tick))
      spdlog::log(message.warning ? spdlog::level::warn : spdlog::level::info, "{}", message.text);
    if (recorder != nullptr) recorder->append(to_record(tick));
  }
}

bool finished(const OperatorSessionOptions& options, const HapticDevice& device,
              const TickStatistics& statistics) {
  if (device.ended() || (options.passes > 0 && device.passes() >= options.passes)) return true;
  return options.duration_s > 0 && spent_s(statistics, options.lost_s) >= options.duration_s;
}

TouchLinkOptions link_options_of(const OperatorSessionOptions& options, RecordWriter* recorder) {
  TouchLinkOptions link;
  link.address = options.address;
  link.credentials = options.credentials;
  link.open = options.open;
  link.recorder = recorder;
  return link;
}

void finish(TouchSummary& summary, const TouchLink& link, const ServoLoop& servo,
            const HapticDevice& device) {
  summary.link = link.stats();
  summary.overruns = servo.overruns();
  summary.rejected_answers = servo.rejected_answers();
  summary.telemetry_dropped = servo.telemetry().dropped();
  summary.passes = device.passes();
  summary.device = device.profile().name;
}

// Every image to the device, some to who else looks. Returns when the latter was last.
double show_tactile(const OperatorSessionOptions& options, TouchLink& link, HapticDevice& device,
                    double shown_s, double now_s) {
  const auto image = link.take_tactile();
  if (!image) return shown_s;
  device.show_taxels({image->along_x, image->along_z, image->pitch_m, image->pressure_pa, image->beyond_pa});
  if (!options.tactile || now_s - shown_s < OperatorSessionOptions::kTactileS) return shown_s;
  options.tactile(*image);
  return now_s;
}

TouchSituation situation_of(const TouchLink& link, const TickStatistics& statistics, double width_m,
                            bool has_keys) {
  const ServoTick& tick = statistics.last();
  return {link.trouble(),           tick.state, tick.device_ok, link.covered(), tick.held_at_border,
          tick.pose.position_m.x(), width_m,    has_keys};
}

// The service takes the interior layer that is nearest to the wish.
void say_layer(const OperatorSessionOptions& options, const TouchLinkStats& link) {
  constexpr double kRoundingM = 1e-6;
  const double asked_m = options.open.layer().depth_m();
  if (std::abs(link.layer_depth_m - asked_m) > kRoundingM)
    spdlog::warn("--layer-depth-m {}: no layer lies there; the nearest is touched, at {:.4f} m", asked_m,
                 link.layer_depth_m);
}

void say_keys(const OperatorSessionOptions& options) {
  if (!options.key) return;
  spdlog::info("keys: Enter resumes (with the finger lifted), Space pauses, {}{}Ctrl-C ends",
               is_real(options.device) ? "c clutches and releases, " : "",
               options.hand_over_to.empty() ? "" : "h lets '" + options.hand_over_to + "' steer, ");
}

void obey_keys(const OperatorSessionOptions& options, WorkspaceDevice* real, ServoLoop& servo,
               TouchLink& link) {
  if (!options.key) return;
  while (const char key = options.key()) {
    if (key == '\n' || key == '\r') servo.request_resume();
    if (key == ' ') servo.request_pause();
    if (key == 'c' && real != nullptr) real->toggle_clutch();
    if (key != 'h') continue;
    if (options.hand_over_to.empty())
      spdlog::warn("h: name the session that the probe should follow with --hand-over-to");
    else
      link.hand_over(options.hand_over_to);
  }
}

}  // namespace

TouchSummary run_operator_session(const OperatorSessionOptions& options, const std::atomic<bool>& stop) {
  ServoOptions servo_options;
  const v1::Scene scene = wait_for_scene(options, stop);
  const HandOptions hand = hand_on(scene, options);
  const DeviceChoice choice{options.device, options.profile, hand, options.workspace};
  const auto real = is_real(options.device) ? make_real_device(choice) : nullptr;
  const auto simulated = real ? nullptr : make_device(choice);
  HapticDevice* const device = real ? real.get() : simulated.get();
  // Destroyed in the opposite order: the force goes first, while the link still answers; the device last.
  const OpenDevice open(*device);
  if (real) {
    spdlog::info("the device stands at x = {:.3f} m of {:.3f} m, {:.0f} mm above the tissue", hand.start_m,
                 width_of(scene), 1e3 * hand.hover_m);
    say_workspace(options.workspace, real->profile());
  }
  Kept kept(options);
  servo_options.chain.limits = device->profile().limits();
  const auto renderer = make_renderer(options.renderer, servo_options.period_s, servo_options.chain.limits);
  MonotonicClock clock;
  const auto servo = std::make_unique<ServoLoop>(*device, *renderer, clock, servo_options);
  TouchLinkOptions link_options = link_options_of(options, kept.recorder.get());
  if (options.renderer == "law") link_options.laws = &servo->laws();
  TouchLink link(std::move(link_options), servo->poses(), servo->answers(), clock);
  ServoThread servo_thread(*servo, {options.real_time, options.servo_begins, options.servo_ended});

  TouchSummary summary;
  link.start();
  TickLog log;
  Waiting waiting(options.still_s);
  AdapterWatch adapter;
  say_keys(options);
  bool layer_said = false;
  double tactile_shown_s = 0, figures_s = 0;
  while (!stop && link.failure().empty() && !servo_thread.over() && !adapter.stuck() &&
         !finished(options, *device, summary.ticks)) {
    std::this_thread::sleep_for(Seconds(kDrainS));
    drain(*servo, summary.ticks, log, kept.recorder.get());
    const std::optional<RealTime> granted = servo_thread.real_time();
    if (granted && summary.real_time.text.empty()) spdlog::info("servo: {}", granted->text);
    summary.real_time = granted.value_or(RealTime());
    if (!layer_said && (layer_said = link.stats().streams > 0)) say_layer(options, link.stats());
    obey_keys(options, real.get(), *servo, link);
    if (real) say_news(*real);
    const double now_s = seconds(clock.now_ns());
    if (now_s - figures_s >= kFiguresS) {
      figures_s = now_s;
      finish(summary, link, *servo, *device);
      kept.append(summary, clock.now_ns());
    }
    const std::string slow = servo_thread.looping() ? adapter.message(*device, servo->ticks(), now_s) : "";
    if (!slow.empty()) spdlog::warn("{}", slow);
    tactile_shown_s = show_tactile(options, link, *device, tactile_shown_s, now_s);
    const bool has_keys = static_cast<bool>(options.key);
    const std::string message =
        waiting.message(situation_of(link, summary.ticks, width_of(scene), has_keys), now_s);
    if (!message.empty()) spdlog::warn("{}", message);
  }
  servo_thread.stop();
  link.stop();
  drain(*servo, summary.ticks, log, kept.recorder.get());
  finish(summary, link, *servo, *device);
  kept.append(summary, clock.now_ns());
  if (kept.recorder) {
    summary.record_dropped = kept.recorder->dropped();
    kept.recorder->close();
  }
  if (adapter.stuck())
    throw std::runtime_error("touching ended: the device's adapter did not return from a call");
  if (!link.failure().empty()) throw std::runtime_error("touching ended: " + link.failure());
  return summary;
}

}  // namespace teletact::client
