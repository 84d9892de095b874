// teletact-client touch: the operator side.
#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/commands/commands.h"
#include "client/commands/device_options.h"
#include "client/commands/touch_summary.h"
#include "client/files/different_files.h"
#include "client/render/renderers.h"
#include "client/servo/ending.h"
#include "client/session/keyboard.h"
#include "client/session/operator_session.h"
#include "client/session/tactile_view.h"

namespace teletact::client {
namespace {

struct TouchArguments {
  OperatorSessionOptions session;
  std::string tip = "rounded";
  std::string path = "auto";
  std::string json_path;
  double tip_radius_m = 0;
  double tip_half_width_m = 0;
  double tip_footprint_m = 0.001;  // one node spacing: smooth between nodes (T4.5b)
  bool stuck = false;
  bool pressure = false;
  double tolerance = -1;  // negative: not asked for
  bool tactile = false;
  unsigned taxels = 8;
  double taxel_pitch_m = 0.002;
  double pad_thickness_m = 0, pad_modulus_pa = 0;
  bool force = false;
  std::string scene_id, session_id;
  double layer_depth_m = 0;
  double period_s = 0.002;
};

constexpr double kToleratedN = 0.005;  // less is hardly felt

const std::map<std::string, v1::FingertipShape> kTips = {{"rounded", v1::FINGERTIP_SHAPE_ROUNDED_TIP},
                                                         {"punch", v1::FINGERTIP_SHAPE_FLAT_PUNCH},
                                                         {"node", v1::FINGERTIP_SHAPE_NODE},
                                                         {"pad", v1::FINGERTIP_SHAPE_PAD},
                                                         {"sphere", v1::FINGERTIP_SHAPE_SPHERE}};
const std::map<std::string, v1::SolvePath> kPaths = {{"auto", v1::SOLVE_PATH_UNSPECIFIED},
                                                     {"compliance", v1::SOLVE_PATH_COMPLIANCE},
                                                     {"gradients", v1::SOLVE_PATH_GRADIENTS},
                                                     {"shares", v1::SOLVE_PATH_SHARES}};

v1::TouchOpen to_open(const TouchArguments& arguments) {
  v1::TouchOpen open;
  open.set_scene_id(arguments.scene_id);
  v1::Fingertip& tip = *open.mutable_fingertip();
  tip.set_shape(kTips.at(arguments.tip));
  tip.set_stuck(arguments.stuck);
  tip.set_radius_m(arguments.tip_radius_m);
  tip.set_half_width_m(arguments.tip_half_width_m);
  tip.set_footprint_m(arguments.tip_footprint_m);
  tip.set_pad_thickness_m(arguments.pad_thickness_m);
  tip.set_pad_youngs_modulus_pa(arguments.pad_modulus_pa);
  open.mutable_layer()->set_depth_m(arguments.layer_depth_m);
  open.set_path(kPaths.at(arguments.path));
  open.set_pressure(arguments.pressure);
  if (arguments.tolerance >= 0) {
    open.mutable_tolerance()->set_relative(arguments.tolerance);
    open.mutable_tolerance()->set_force_n(kToleratedN);
  }
  if (arguments.tactile) {
    open.mutable_tactile()->set_taxels_x(arguments.taxels);
    open.mutable_tactile()->set_taxels_z(arguments.taxels);
    open.mutable_tactile()->set_pitch_m(arguments.taxel_pitch_m);
  }
  open.set_credit(Pacing::kMax);
  open.set_period_s(arguments.period_s);
  open.set_session_id(arguments.session_id);
  return open;
}

// Empty unless the device is a recording.
std::string played_recording(const std::string& device) {
  const std::string kind = "replay:";
  return device.rfind(kind, 0) == 0 ? device.substr(kind.size()) : "";
}

[[noreturn]] void throw_not_writable(const std::string& json_path) {
  throw CommandError("cannot write '" + json_path + "' (" + std::strerror(errno) +
                     "); choose another file with --json");
}

// Before a session that would be lost. What is there stays as it is, and what is not there does not appear.
void require_writable(const std::string& json_path) {
  namespace fs = std::filesystem;
  if (json_path.empty()) return;
  std::error_code ignored;
  const bool there = fs::exists(json_path, ignored), is_folder = fs::is_directory(json_path, ignored);
  const bool writable =
      there ? !is_folder && ::access(json_path.c_str(), W_OK) == 0 : std::ofstream(json_path).is_open();
  if (is_folder) errno = EISDIR;
  if (!writable) throw_not_writable(json_path);
  if (!there) fs::remove(json_path, ignored);
}

// Before the device moves; the service may allow less.
void require_tip(const char* option, double length_m) {
  constexpr double kMaxM = 0.014;
  if (length_m > kMaxM)
    throw UsageError(fmt::format("{} {}: give it in metres, at most {}; a fingertip has about 0.008", option,
                                 length_m, kMaxM));
}

void run(TouchArguments arguments, const CLI::App& command) {
  require_device_options(command, arguments.session.device, arguments.session.workspace);
  require_tip("--tip-radius-m", arguments.tip_radius_m);
  require_tip("--tip-half-width-m", arguments.tip_half_width_m);
  require_different_files({{"--device replay", played_recording(arguments.session.device)},
                           {"--record", arguments.session.record_path},
                           {"--json", arguments.json_path}});
  require_new_files({{"--record", arguments.session.record_path}, {"--json", arguments.json_path}},
                    arguments.force);
  auto logger = spdlog::get("touch");
  if (!logger) logger = spdlog::stderr_color_mt("touch");
  spdlog::set_default_logger(logger);
  require_writable(arguments.json_path);
  arguments.session.open = to_open(arguments);
  TouchSummary summary;
  Keyboard keyboard;
  const bool terminal = ::isatty(STDOUT_FILENO) == 1;
  const auto screen = std::make_shared<TactileScreen>(terminal);
  if (arguments.tactile)
    arguments.session.tactile = [screen](const TactileImage& image) {
      std::fputs(screen->frame(image).c_str(), stdout);
      std::fflush(stdout);
    };
  if (keyboard.present()) arguments.session.key = [&keyboard] { return keyboard.key(); };
  try {
    summary = run_operator_session(arguments.session, end_in_order());
  } catch (const std::exception& error) {
    throw CommandError(with_flags(error.what(), {{"open.fingertip.radius_m", "--tip-radius-m"},
                                                 {"open.fingertip.half_width_m", "--tip-half-width-m"},
                                                 {"open.fingertip.footprint_m", "--tip-footprint-m"},
                                                 {"open.fingertip.pad_thickness_m", "--pad-thickness-m"},
                                                 {"open.fingertip.pad_youngs_modulus_pa", "--pad-modulus-pa"},
                                                 {"open.fingertip.shape", "--tip"},
                                                 {"open.tactile.pitch_m", "--taxel-pitch-m"},
                                                 {"open.tolerance.relative", "--tolerance"},
                                                 {"open.layer.depth_m", "--layer-depth-m"},
                                                 {"open.path", "--path"}}));
  }
  const nlohmann::json json = to_json(arguments.scene_id, arguments.session.renderer, summary);
  print_summary(json);
  if (!arguments.json_path.empty() && !(std::ofstream(arguments.json_path) << json.dump(2) << '\n'
                                                                           << std::flush))
    throw_not_writable(arguments.json_path);
}

void add_tip_options(CLI::App& command, TouchArguments& arguments) {
  command.option_defaults()->group("What is touched");
  command
      .add_option("--tip-radius-m", arguments.tip_radius_m,
                  "radius of the tip, or of a punch's edges, 0.0001 to 0.014")
      ->check(above_zero())
      ->default_str("0.008, of a pad 0.001");
  command
      .add_option("--tip-half-width-m", arguments.tip_half_width_m, "half of a punch's or a pad's flat part")
      ->check(above_zero())
      ->default_str("0.004, of a pad 0.008");
  command.add_option("--pad-thickness-m", arguments.pad_thickness_m, "of a pad's elastic layer")
      ->check(above_zero())
      ->default_str("0.002");
  command
      .add_option("--pad-modulus-pa", arguments.pad_modulus_pa, "Young's modulus of a pad's elastic layer")
      ->check(above_zero())
      ->default_str("20000");
  command.add_option(
      "--tip-footprint-m", arguments.tip_footprint_m,
      "of a node: Gaussian footprint; 0: one node, as in the paper: lateral force jumps at nodes");
  command.add_flag("--stuck", arguments.stuck, "the tissue sticks to the tip (else frictionless)");
  CLI::Option* tactile = command.add_flag(
      "--tactile", arguments.tactile,
      "also receive tactile images, shown here and recorded; for solid tissue, what a lump adds is shown "
      "beside them");
  command.add_option("--taxels", arguments.taxels, "of a tactile image, along x and along z")
      ->check(CLI::Range(1U, 32U))
      ->needs(tactile);
  command.add_option("--taxel-pitch-m", arguments.taxel_pitch_m, "of a tactile image, 0.0005 to 0.01")
      ->check(above_zero())
      ->needs(tactile);
}

void add_rendering_options(CLI::App& command, TouchArguments& arguments) {
  command.option_defaults()->group("Rendering");
  command
      .add_option(
          "--renderer", arguments.session.renderer,
          "law (the tissue's contact law, felt without the link's delay; where there is none as kalman) or "
          "kalman, the filter of answers")
      ->check(CLI::IsMember(renderer_names()));
  command
      .add_option(
          "--tolerance", arguments.tolerance,
          "largest relative force error of the model: answers that may be off by more, and by over 5 mN, "
          "are DEGRADED; for round tips on solids; without it the service decides")
      ->check(CLI::Range(0.0, 1.0))
      ->default_str("");
  command
      .add_option(
          "--path", arguments.path,
          "auto, compliance or gradients (slow on planes: ask for a --period-s to match); of a solid also "
          "shares, a closed form, which auto takes where it is good enough")
      ->check(CLI::IsMember(kPaths));
}

void add_link_options(CLI::App& command, TouchArguments& arguments) {
  command.option_defaults()->group(kLink);
  command.add_option("--period-s", arguments.period_s, "desired time between answers")
      ->check(CLI::Range(0.001, 1.0));
  command.add_option(
      "--session", arguments.session_id,
      "name of this touch for others: one touch of a scene steers its probe (default: random)");
  command.add_option("--hand-over-to", arguments.session.hand_over_to,
                     "session that steers once h is pressed here; without it h does nothing");
}

void add_recording_options(CLI::App& command, TouchArguments& arguments) {
  command.option_defaults()->group(kRecording);
  command.add_option("--json", arguments.json_path,
                     "write the summary to this file, too (default: only printed)");
  command.add_flag("--pressure", arguments.pressure, "also record the nodal pressures: twice the bytes");
}

void add_hand_options(CLI::App& command, OperatorSessionOptions& session) {
  command.option_defaults()->group(kSimulatedDevice);
  command.add_option("--profile", session.profile,
                     "its limits, also of a replayed one: premium-1.5, premium-3.0, omni or touch");
  command.add_option("--passes", session.passes, "end after this many sweeps; 0: no limit");
  command.add_option("--indentation-m", session.hand.indentation_m, "mean indentation")
      ->check(CLI::Range(1e-4, 0.05));
  command.add_option("--speed-m-s", session.hand.speed_m_s, "of the sweep")->check(CLI::Range(0.001, 0.5));
  command.add_option("--begin-m", session.begin_m,
                     "sweep from here, metres along the tissue (default: what is covered at the start)");
  command.add_option("--end-m", session.end_m, "sweep to here (default: as --begin-m)");
  command
      .add_option_function<std::string>(
          "--along", [&session](const std::string& axis) { session.hand.along_z = axis == "z"; },
          "axis of the sweep: x, or z of solid tissue")
      ->check(CLI::IsMember({"x", "z"}))
      ->default_str("x");
  command.add_option("--across-m", session.across_m,
                     "where the sweep's line lies on the other axis (default: amid the tissue)");
  command
      .add_option("--circle-radius-m", session.hand.circle_radius_m,
                  "circle around a point that advances by this radius in each turn; 0: straight")
      ->check(CLI::Range(0.0, 0.05));
  command.add_option("--hand-mass-kg", session.hand.mass_kg, "of the hand")->check(CLI::Range(0.01, 0.2));
  command.add_option("--hand-damping-n-s-m", session.hand.damping_n_s_m, "of the hand")
      ->check(CLI::Range(2.0, 10.0));
  command.add_option("--hand-stiffness-n-m", session.hand.stiffness_n_m, "of the hand")
      ->check(CLI::Range(200.0, 1000.0));
}

// Those that most sessions have.
void add_usual_options(CLI::App& command, TouchArguments& arguments) {
  OperatorSessionOptions& session = arguments.session;
  command.add_option("--scene", arguments.scene_id, "scene to touch")->required();
  command.add_option("--device", session.device,
                     "haptic device: simulated, simulated-position, plugin:FILE[,SETTINGS], "
                     "inverse3[:ws://HOST:PORT], replay:RECORDING");
  add_device_settings(command);
  command
      .add_option("--tip", arguments.tip,
                  "fingertip: rounded, punch, node; pad or sphere (solid tissue alone)")
      ->check(CLI::IsMember(kTips));
  command.add_option("--layer-depth-m", arguments.layer_depth_m,
                     "depth of the touched layer, 0 = the surface");
  command
      .add_option("--wait-s", session.wait_s, "wait so long for the service, the scene and its first window")
      ->check(zero_or_more());
  command
      .add_option("--duration-s", session.duration_s,
                  "end after this long with force on; outages of over 5 s count too. 0: no limit. "
                  "Without a limit it runs until Ctrl-C")
      ->check(zero_or_more());
  command.add_option("--record", session.record_path,
                     "keep poses, answers and every servo tick in this file; without it nothing is kept");
  add_force_option(command, arguments.force);
}

}  // namespace

void add_touch_command(CLI::App& app) {
  const auto arguments = std::make_shared<TouchArguments>();
  OperatorSessionOptions& session = arguments->session;
  CLI::App& command = *app.add_subcommand("touch", "operator side: feel a scene of a running service");
  add_service_options(command, session.address, session.credentials);
  add_usual_options(command, *arguments);
  add_tip_options(command, *arguments);
  add_rendering_options(command, *arguments);
  add_workspace_options(command, session.workspace);
  add_scale_options(command, session.workspace);
  command.add_option("--start-x-m", session.start_x_m,
                     "where on the tissue it begins (default: amid what is covered)");
  add_hand_options(command, session);
  add_link_options(command, *arguments);
  add_recording_options(command, *arguments);
  retire(command, "--credit", "the link finds how many answers are in flight; --period-s asks for fewer");
  command.footer(
      "The summary's words: a stall is the hand held for more than 1 ms at the border of what is covered; "
      "force\n"
      "is lost while PAUSED or in FAULT, fading while answers stay away, DEGRADED (and fading) while the "
      "answer\n"
      "behind it is old or the display generates energy; DEGRADED by the service while that does not trust "
      "its\n"
      "answer: then it is felt as it is.\n"
      "At a terminal Enter resumes (with the finger lifted), Space pauses, c clutches a real device and "
      "releases\n"
      "it, h hands the probe over, Ctrl-C ends.");
  command.callback([arguments, &command] { run(*arguments, command); });
}

}  // namespace teletact::client
