// teletact-client acquire: the patient side.
#include <fmt/format.h>
#include <grpcpp/client_context.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "client/acquire/modulus_names.h"
#include "client/acquire/session.h"
#include "client/acquire/simulated_source.h"
#include "client/acquire/solid_source.h"
#include "client/acquire/spoiled_source.h"
#include "client/commands/acquire_recorder.h"
#include "client/commands/commands.h"
#include "client/commands/modulus_options.h"
#include "client/files/different_files.h"
#include "client/files/file_io.h"
#include "client/files/metaimage.h"
#include "client/link/channel.h"
#include "client/link/scenes.h"
#include "client/servo/ending.h"

namespace teletact::client {
namespace {

struct AcquireArguments {
  std::string address, tissue_path, save_tissue_path, record_path, spoil_path, ready_path;
  Credentials credentials;
  std::optional<std::uint64_t> seed;
  std::size_t passes = 5;
  bool record_rf = false, force = false;
  AcquireOptions acquire;
  // Of a solid:
  std::optional<std::size_t> slices;
  double slice_pitch_m = 0.005;
  std::optional<double> first_slice_z_m;  // absent: as many before z = 0 as behind it
  bool unlike_model = false;
  std::string save_modulus_path, save_log_std_path;
};

Tissue tissue_of(const AcquireArguments& arguments) {
  if (!arguments.tissue_path.empty()) return read_tissue(arguments.tissue_path);
  if (arguments.unlike_model) return unlike_model(*arguments.seed);
  return arguments.slices ? random_solid_tissue(*arguments.seed) : random_tissue(*arguments.seed);
}

SlicePlaces places_of(const AcquireArguments& arguments) {
  const double pitch_m = arguments.slice_pitch_m;
  const auto count = *arguments.slices;
  return {count, arguments.first_slice_z_m.value_or(-pitch_m * static_cast<double>(count - 1) / 2), pitch_m};
}

// Of the tissue under the probe, which stands on the middle of it.
SliceOptions slices_of(const AcquireArguments& arguments, const Tissue& tissue) {
  SliceOptions slices;
  slices.grid = {tissue.probe.width_m, tissue.depth_m, tissue.poisson_ratio, places_of(arguments)};
  slices.probe_elevation_m = tissue.probe.elevation_m;
  return slices;
}

// A solid's scene is made with its first slice.
void require_no_scene(v1::Palpation::Stub& palpation, const std::string& scene_id) {
  v1::Scene scene;
  const grpc::Status got = get_scene(palpation, scene_id, v1::SCENE_VIEW_BASIC, scene);
  if (got.ok())
    throw CommandError(fmt::format(
        "--scene {}: it exists ({}); slices make a scene of their own, so choose another name or delete it "
        "(scenes --delete {})",
        scene_id, kind_of(scene), scene_id));
  if (got.error_code() == grpc::StatusCode::INVALID_ARGUMENT)
    throw CommandError(with_flags(got.error_message(), {{"scene_id", "--scene " + scene_id}}));
  if (got.error_code() != grpc::StatusCode::NOT_FOUND) throw_status("GetScene", got);
}

// Creates the scene, or goes on with one that has the tissue's size.
void open_scene(v1::Palpation::Stub& palpation, const std::string& scene_id, const Tissue& tissue) {
  v1::CreateSceneRequest request;
  request.set_scene_id(scene_id);
  v1::SceneGeometry& geometry = *request.mutable_geometry();
  geometry.add_size_m(tissue.width_m);
  geometry.add_size_m(tissue.depth_m);
  geometry.set_poisson_ratio(tissue.poisson_ratio);
  geometry.set_has_poisson_ratio(true);
  geometry.set_thickness_m(tissue.thickness_m);
  v1::Scene scene;
  grpc::ClientContext create;
  name_scene(create, scene_id);
  const grpc::Status status = palpation.CreateScene(&create, request, &scene);
  if (status.ok()) return;
  if (status.error_code() == grpc::StatusCode::INVALID_ARGUMENT)
    throw CommandError(with_flags(status.error_message(), {{"scene_id", "--scene " + scene_id}}));
  if (status.error_code() != grpc::StatusCode::ALREADY_EXISTS) throw_status("CreateScene", status);
  if (const grpc::Status got = get_scene(palpation, scene_id, v1::SCENE_VIEW_BASIC, scene); !got.ok())
    throw_status("GetScene", got);
  for (int axis = 0; axis < 2; ++axis)
    if (scene.geometry().size_m_size() < 2 ||
        std::abs(scene.geometry().size_m(axis) - geometry.size_m(axis)) > 1e-9)
      throw CommandError("--scene " + scene_id + ": it exists with another size; choose another scene");
  const std::string has = fmt::format("scene {} exists, with {} windows: ", scene_id, scene.windows_size());
  say(scene.windows_size() == 0 ? has + "it is used"
                                : "warning: " + has +
                                      "they stay beside this patient's until those replace them. If they are "
                                      "another's, end this, and give another --scene");
}

void say_doubts(const v1::EstimateSummary& summary) {
  for (const std::string& warning : summary.warnings()) std::printf("  doubtful: %s\n", warning.c_str());
  std::fflush(stdout);
}

AcquireObserver observe(const AcquireArguments& arguments, AcquireRecorder& recorder) {
  AcquireObserver observer;
  observer.request = [&recorder](auto call, const auto& request) { recorder.request(call, request); };
  observer.response = [&recorder](auto call, const auto& response) { recorder.response(call, response); };
  observer.window = [&recorder, &arguments](auto call, const v1::WindowTiming& timing,
                                            const v1::EstimateSummary& summary) {
    recorder.window(call, timing);
    const std::string place = arguments.slices
                                  ? fmt::format("slice z {:5.1f} mm", timing.window().origin_m(2) * 1e3)
                                  : fmt::format("window {:3.0f} mm", timing.window().origin_m(0) * 1e3);
    double service_s = summary.received_to_published_s();
    if (arguments.slices)  // published by a call of its own
      for (const v1::StageTime& stage : summary.stages()) service_s += stage.seconds();
    std::printf("%s  pass %u  asked to published %.0f ms, service %.0f ms, background %s\n", place.c_str(),
                timing.pass() + 1, (timing.published_ns() - timing.asked_ns()) * 1e-6, service_s * 1e3,
                background_of(summary.background_modulus_pa(), summary.youngs_modulus_log_std()).c_str());
    say_doubts(summary);
  };
  const auto say_slice = [&arguments](std::size_t slice, const char* words, std::uint64_t version) {
    std::printf("  slice %zu of %zu %s: version %llu\n", slice + 1, *arguments.slices, words,
                static_cast<unsigned long long>(version));
    std::fflush(stdout);
  };
  observer.slice = [=](std::size_t slice, std::uint64_t version) {
    say_slice(slice, "can be touched", version);
  };
  observer.corrected = [=](std::size_t slice, std::uint64_t version, const v1::EstimateSummary& summary) {
    say_slice(slice, "is corrected by its neighbours", version);
    say_doubts(summary);
  };
  observer.note = [&recorder](const std::string& text) {
    say(text);
    recorder.note(text);
  };
  observer.ready = [&arguments] {
    if (arguments.ready_path.empty()) return;
    if (!(std::ofstream(arguments.ready_path) << "ready\n" << std::flush))
      std::fprintf(stderr, "cannot write --ready-file %s\n", arguments.ready_path.c_str());
  };
  return observer;
}

std::unique_ptr<FrameSource> prepare_slices(const Tissue& tissue, const AcquireArguments& arguments) {
  std::fprintf(stderr,
               "pressing the probe into the patient's tissue (%.0f x %.0f x %.0f mm, %zu inclusions)\n",
               tissue.width_m * 1e3, tissue.depth_m * 1e3, tissue.solid->elevational_width_m * 1e3,
               tissue.inclusions.size());
  return std::make_unique<SolidSource>(
      tissue, places_of(arguments), arguments.passes, [&](std::size_t done, std::size_t total) {
        std::fprintf(stderr, "simulated RF of %zu of %zu slices, %zu passes each\n", done, total,
                     arguments.passes);
      });
}

std::unique_ptr<FrameSource> prepare(const Tissue& tissue, const AcquireArguments& arguments) {
  if (arguments.slices) return prepare_slices(tissue, arguments);
  std::fprintf(stderr, "solving the patient's tissue (%.0f x %.0f mm, %zu inclusions)\n",
               tissue.width_m * 1e3, tissue.depth_m * 1e3, tissue.inclusions.size());
  const Patient patient(tissue);
  return std::make_unique<SimulatedSource>(
      patient, arguments.passes, [&](std::size_t done, std::size_t total) {
        std::fprintf(stderr, "simulated RF of %zu of %zu windows, %zu passes each\n", done, total,
                     arguments.passes);
      });
}

void check(const AcquireArguments& arguments) {
  if (arguments.tissue_path.empty() && !arguments.seed)
    throw UsageError("no patient is given: give --tissue FILE or --seed N");
  require_different_files({{"--tissue", arguments.tissue_path},
                           {"--save-tissue", arguments.save_tissue_path},
                           {"--record", arguments.record_path},
                           {"--save-modulus", arguments.save_modulus_path},
                           {"--save-log-std", arguments.save_log_std_path},
                           {"--ready-file", arguments.ready_path}});
  require_new_files({{"--save-tissue", arguments.save_tissue_path},
                     {"--save-modulus", arguments.save_modulus_path},
                     {"--save-log-std", arguments.save_log_std_path},
                     {"--record", arguments.record_path}},
                    arguments.force);
}

AcquireResult acquire(AcquireSession& session) {
  try {
    return session.run(end_in_order());
  } catch (const ServiceError& error) {
    if (std::string(error.what()).find("NOT_FOUND") == std::string::npos &&
        error.code != grpc::StatusCode::UNAVAILABLE)
      throw;
    throw CommandError(
        std::string(error.what()) +
        "; the service went away, or was started again without its scenes: start it with --state "
        "DIR, then acquire again");
  }
}

void save_slices(const AcquireArguments& arguments, const SliceGrid& grid,
                 const std::map<std::size_t, SlicePlane>& planes) {
  const std::size_t missing = *arguments.slices - planes.size();
  if (missing > 0)
    std::printf(
        "%zu of %zu slices could not be estimated, or not in time: what lies there continues its "
        "neighbours\n",
        missing, *arguments.slices);
  if (!arguments.save_modulus_path.empty())
    write_metaimage(arguments.save_modulus_path, slice_volume(grid, planes, &SlicePlane::pa));
  if (!arguments.save_log_std_path.empty())
    write_metaimage(arguments.save_log_std_path, slice_volume(grid, planes, &SlicePlane::log_std));
}

void run(const AcquireArguments& arguments) {
  check(arguments);
  const Tissue tissue = tissue_of(arguments);
  if (arguments.slices)
    if (const std::string problem = slice_problem(tissue, places_of(arguments)); !problem.empty())
      throw UsageError("--slices " + std::to_string(*arguments.slices) + ": " + problem);
  if (!(arguments.acquire.start_x_m >= 0 && arguments.acquire.start_x_m <= tissue.width_m))
    throw UsageError(fmt::format("--start-x-m {}: the tissue reaches from 0 to {} m",
                                 arguments.acquire.start_x_m, tissue.width_m));
  if (!arguments.save_tissue_path.empty()) write_tissue(arguments.save_tissue_path, tissue);
  const auto channel = reach_service(arguments.address, arguments.credentials, say);
  const auto palpation = v1::Palpation::NewStub(channel);
  if (arguments.slices)
    require_no_scene(*palpation, arguments.acquire.scene_id);
  else
    open_scene(*palpation, arguments.acquire.scene_id, tissue);
  AcquireRecorder recorder(arguments.record_path, arguments.address, arguments.acquire.scene_id,
                           arguments.record_rf);
  recorder.info(get_info(channel));
  std::unique_ptr<FrameSource> source = prepare(tissue, arguments);
  if (!arguments.spoil_path.empty())
    source = std::make_unique<SpoiledSource>(std::move(source), arguments.spoil_path);
  end_in_order();  // from here on; the simulation before is simply cut off
  AcquireOptions options = arguments.acquire;
  options.all_maps = arguments.record_rf;
  if (arguments.slices) {
    options.slices = slices_of(arguments, tissue);
    options.planner.all = true;
    options.start_x_m = 0;
  }
  options.start_direction = options.start_x_m > tissue.width_m / 2 ? -1 : 1;
  AcquireSession session(arguments.address, arguments.credentials, *source, options,
                         observe(arguments, recorder));
  const AcquireResult result = acquire(session);
  std::printf("%zu %s published, %zu pairs refused\n", result.windows.size(),
              arguments.slices ? "slices" : "windows", result.refused);
  if (arguments.slices)
    save_slices(arguments, options.slices->grid, session.planes());
  else if (result.exhausted > 0)
    std::printf(
        "%zu windows have no frames left and could not be acquired again: prepare more with "
        "--passes-prepared "
        "(%zu)\n",
        result.exhausted, arguments.passes);
  if (!recorder.recording()) return;
  v1::Scene scene;
  const grpc::Status status = get_scene(*palpation, arguments.acquire.scene_id, v1::SCENE_VIEW_FULL, scene);
  if (!status.ok()) throw_status("GetScene", status);
  recorder.close(scene);
}

// Returns --slices.
CLI::Option* add_slice_options(CLI::App& command, AcquireArguments& arguments) {
  CLI::Option* slices =
      command
          .add_option(
              "--slices", arguments.slices,
              "solid tissue: so many image planes side by side, which the arm takes across the plane; "
              "without it the tissue is plane")
          ->check(CLI::Range(1, 1000));
  command.option_defaults()->group("Slices");
  command.add_option("--slice-pitch-m", arguments.slice_pitch_m, "from one slice to the next")
      ->check(above_zero())
      ->needs(slices);
  command
      .add_option("--first-slice-z-m", arguments.first_slice_z_m,
                  "where the first one lies; without it the middle one lies at z = 0")
      ->needs(slices);
  command
      .add_flag("--unlike-model", arguments.unlike_model,
                "--seed's patient violates every assumption of an estimate")
      ->needs(slices, command.get_option("--seed"));
  command
      .add_option("--save-modulus", arguments.save_modulus_path,
                  "write the slices' moduli, a volume (.mha) that slices takes; without it they are not kept")
      ->needs(slices);
  command
      .add_option("--save-log-std", arguments.save_log_std_path,
                  "the same of the standard deviations of their logarithms; without it they are not kept")
      ->needs(slices);
  return slices;
}

void add_estimate_options(CLI::App& command, AcquireOptions& acquire, CLI::Option* slices) {
  command.option_defaults()->group("Estimate");
  add_modulus_options(command, acquire.modulus_method, acquire.modulus_time_limit_s);
  command.get_option("--modulus-method")->excludes(slices);
  add_plane_option(command, acquire.plane, "strain");
  command.get_option("--plane")->excludes(slices);
  add_uncertainty_options(command, acquire.stated);
  command.get_option("--probe-elevation-std-m")->needs(slices);
  command.get_option("--surface")->needs(slices);
  command.get_option("--tissue-width-std-m")->excludes(slices);
}

void add_window_options(CLI::App& command, AcquireArguments& arguments, CLI::Option* slices) {
  AcquireOptions& acquire = arguments.acquire;
  command.option_defaults()->group("Windows, and their order");
  command
      .add_option("--start-x-m", acquire.start_x_m,
                  "where the finger is expected first; from there it goes to the end that is farther away")
      ->excludes(slices);
  command.add_option("--lookahead", acquire.planner.lookahead, "windows acquired ahead of the finger")
      ->check(CLI::Range(1, 8));
  command
      .add_option("--refresh-after-s", acquire.planner.refresh_after_s, "older windows are acquired again")
      ->check(above_zero());
  command.add_option("--passes-prepared", arguments.passes, "RF pairs simulated for each window beforehand")
      ->check(CLI::Range(1, 1000));
}

void add_recording_options(CLI::App& command, AcquireArguments& arguments) {
  command.option_defaults()->group(kRecording);
  command
      .add_flag("--record-rf", arguments.record_rf,
                "keep RF and maps too, so that replay can play them again")
      ->needs("--record");
  command.option_defaults()->group("For scripts");
  command.add_option("--ready-file", arguments.ready_path,
                     "created once the first windows can be touched; without it none is");
  command.add_option(
      "--spoil", arguments.spoil_path,
      "named pipe whose lines, force or decorrelated, each spoil the next pair; without it none is");
}

// What is otherwise with slices, unless it is given.
void prefer_slices(const CLI::App& command, AcquireArguments& arguments) {
  constexpr double kTimeLimitS = 20;
  AcquireOptions& acquire = arguments.acquire;
  if (command.count("--modulus-time-limit-s") == 0) acquire.modulus_time_limit_s = kTimeLimitS;
  if (command.count("--refresh-after-s") == 0) acquire.planner.refresh_after_s = HUGE_VAL;
}

}  // namespace

void add_acquire_command(CLI::App& app) {
  const auto arguments = std::make_shared<AcquireArguments>();
  AcquireOptions& acquire = arguments->acquire;
  CLI::App& command =
      *app.add_subcommand("acquire", "patient side: probe, arm and RF upload (a simulated patient)");
  add_service_options(command, arguments->address, arguments->credentials);
  command.add_option("--scene", acquire.scene_id, "scene to publish into; created with the tissue's size")
      ->required();
  CLI::Option* tissue = command.add_option("--tissue", arguments->tissue_path,
                                           "tissue file (TOML); without it the patient is --seed's");
  command
      .add_option("--seed", arguments->seed,
                  "a random patient with hidden inclusions; without it the patient is --tissue's")
      ->excludes(tissue);
  command.add_option("--save-tissue", arguments->save_tissue_path,
                     "write the tissue, the truth for report (default: not kept)");
  command.add_flag("--until-finger-leaves", acquire.until_finger_leaves,
                   "end when the finger has come and gone");
  command
      .add_option("--duration-s", acquire.duration_s,
                  "end after so long; without it the finger's leaving or Ctrl-C ends it")
      ->check(above_zero());
  command.add_option("--record", arguments->record_path,
                     "keep timings, summaries and the final scene in this file; without it nothing is kept");
  add_force_option(command, arguments->force);
  CLI::Option* slices = add_slice_options(command, *arguments);
  add_estimate_options(command, acquire, slices);
  add_window_options(command, *arguments, slices);
  add_recording_options(command, *arguments);
  retire(command, "--threads", "start it by taskset -c 0-3 to leave it four processors");
  retire(command, "--start-direction", "the finger is expected to go from --start-x-m to the farther end");
  command.callback([arguments, &command] {
    if (arguments->slices) prefer_slices(command, *arguments);
    run(*arguments);
  });
}

}  // namespace teletact::client
