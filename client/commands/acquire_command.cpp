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

#include "client/acquire/session.h"
#include "client/acquire/simulated_source.h"
#include "client/clock/clock.h"
#include "client/commands/commands.h"
#include "client/commands/modulus_options.h"
#include "client/files/different_files.h"
#include "client/files/file_io.h"
#include "client/link/channel.h"
#include "client/link/recording.h"
#include "client/link/scenes.h"
#include "client/servo/ending.h"

namespace teletact::client {
namespace {

struct Arguments {
  std::string address, tls_ca, tissue_path, save_tissue_path, record_path, ready_path;
  std::optional<std::uint64_t> seed;
  std::size_t passes = 5;
  unsigned threads = 0;
  bool record_rf = false, force = false;
  AcquireOptions acquire;
};

Tissue tissue_of(const Arguments& arguments) {
  if (!arguments.tissue_path.empty()) return read_tissue(arguments.tissue_path);
  return random_tissue(*arguments.seed);
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
  say(scene.windows_size() == 0 ? has + "going on with it"
                                : "warning: " + has +
                                      "they stay beside this patient's until those replace them. If they are "
                                      "another's, end this, and give another --scene");
}

// Everything that the recording gets, in one place; calls come from several threads.
class Recorder {
 public:
  explicit Recorder(const Arguments& arguments) : with_rf_(arguments.record_rf) {
    if (arguments.record_path.empty()) return;
    v1::RecordHeader header;
    header.set_kind("acquire");
    header.set_client("teletact-client");
    header.set_service(arguments.address);
    header.set_scene_id(arguments.acquire.scene_id);
    header.set_unix_time_s(std::time(nullptr));
    writer_.emplace(arguments.record_path, header);
  }
  void request(std::uint32_t call, const v1::EstimateRequest& request) {
    if (with_rf_) append(call, request);
  }
  void response(std::uint32_t call, const v1::EstimateResponse& response) {
    if (response.has_map() && !with_rf_) return;  // maps belong to a recording that can be replayed
    append(call, response);
  }
  void window(std::uint32_t call, const v1::WindowTiming& timing) { append(call, timing); }
  void info(const v1::GetInfoResponse& info) { append(0, info); }
  void close(const v1::Scene& scene) {
    append(0, scene);
    if (writer_) writer_->close();
  }
  bool recording() const { return writer_.has_value(); }

 private:
  template <class Message>
  void append(std::uint32_t call, const Message& message) {
    if (writer_) writer_->append_waiting(recorded(message, monotonic_ns(), call));
  }
  std::optional<RecordWriter> writer_;
  bool with_rf_;
};

AcquireObserver observe(const Arguments& arguments, Recorder& recorder) {
  AcquireObserver observer;
  observer.request = [&recorder](auto call, const auto& request) { recorder.request(call, request); };
  observer.response = [&recorder](auto call, const auto& response) { recorder.response(call, response); };
  observer.window = [&recorder](auto call, const v1::WindowTiming& timing,
                                const v1::EstimateSummary& summary) {
    recorder.window(call, timing);
    std::printf(
        "window %3.0f mm  pass %u  asked to published %.0f ms, service %.0f ms, background %.2f kPa\n",
        timing.window().origin_m(0) * 1e3, timing.pass() + 1,
        (timing.published_ns() - timing.asked_ns()) * 1e-6, summary.received_to_published_s() * 1e3,
        summary.background_modulus_pa() * 1e-3);
    for (const std::string& warning : summary.warnings()) std::printf("  doubtful: %s\n", warning.c_str());
    std::fflush(stdout);
  };
  observer.note = say;
  observer.ready = [&arguments] {
    if (arguments.ready_path.empty()) return;
    if (!(std::ofstream(arguments.ready_path) << "ready\n" << std::flush))
      std::fprintf(stderr, "cannot write --ready-file %s\n", arguments.ready_path.c_str());
  };
  return observer;
}

SimulatedSource prepare(const Tissue& tissue, const Arguments& arguments) {
  std::fprintf(stderr, "solving the patient's tissue (%.0f x %.0f mm, %zu inclusions)\n",
               tissue.width_m * 1e3, tissue.depth_m * 1e3, tissue.inclusions.size());
  const Patient patient(tissue);
  return SimulatedSource(patient, arguments.passes, arguments.threads,
                         [&](std::size_t done, std::size_t total) {
                           std::fprintf(stderr, "simulated RF of %zu of %zu windows, %zu passes each\n", done,
                                        total, arguments.passes);
                         });
}

void check(const Arguments& arguments) {
  if (arguments.tissue_path.empty() == !arguments.seed)
    throw CommandError("give either --tissue FILE or --seed N");
  if (arguments.record_rf && arguments.record_path.empty())
    throw CommandError("--record-rf keeps RF in the recording: give --record FILE too");
  require_different_files({{"--tissue", arguments.tissue_path},
                           {"--save-tissue", arguments.save_tissue_path},
                           {"--record", arguments.record_path},
                           {"--ready-file", arguments.ready_path}});
  require_new_files({{"--save-tissue", arguments.save_tissue_path}, {"--record", arguments.record_path}},
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

void run(const Arguments& arguments) {
  check(arguments);
  const Tissue tissue = tissue_of(arguments);
  if (!(arguments.acquire.start_x_m >= 0 && arguments.acquire.start_x_m <= tissue.width_m))
    throw CommandError(fmt::format("--start-x-m {}: the tissue reaches from 0 to {} m",
                                   arguments.acquire.start_x_m, tissue.width_m));
  if (!arguments.save_tissue_path.empty()) write_tissue(arguments.save_tissue_path, tissue);
  const auto channel = reach_service(arguments.address, arguments.tls_ca, say);
  const auto palpation = v1::Palpation::NewStub(channel);
  open_scene(*palpation, arguments.acquire.scene_id, tissue);
  Recorder recorder(arguments);
  recorder.info(get_info(channel));
  SimulatedSource source = prepare(tissue, arguments);
  end_in_order();  // from here on; the simulation before is simply cut off
  AcquireOptions options = arguments.acquire;
  options.all_maps = arguments.record_rf;
  AcquireSession session(arguments.address, arguments.tls_ca, source, options, observe(arguments, recorder));
  const AcquireResult result = acquire(session);
  std::printf("%zu windows published, %zu pairs not tracked\n", result.windows.size(), result.untracked);
  if (result.exhausted > 0)
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

}  // namespace

void add_acquire_command(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  AcquireOptions& acquire = arguments->acquire;
  CLI::App& command =
      *app.add_subcommand("acquire", "patient side: probe, arm and RF upload (a simulated patient)");
  add_service_options(command, arguments->address, arguments->tls_ca);
  command.add_option("--scene", acquire.scene_id, "scene to publish into; created with the tissue's size")
      ->required();
  command.add_option("--tissue", arguments->tissue_path,
                     "tissue file (TOML); without it the patient is --seed's");
  command.add_option("--seed", arguments->seed,
                     "a random patient with hidden inclusions; without it the patient is --tissue's");
  command.add_option("--save-tissue", arguments->save_tissue_path,
                     "write the tissue, the truth for report; without it it is not kept");
  command.add_option("--passes-prepared", arguments->passes, "RF pairs simulated for each window beforehand")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command.add_option("--threads", arguments->threads, "for the simulation; 0 = one per processor");
  command.add_option("--record", arguments->record_path,
                     "keep timings, summaries and the final scene in this file; without it nothing is kept");
  add_force_option(command, arguments->force);
  command.add_flag("--record-rf", arguments->record_rf,
                   "keep RF and maps too, so that replay can play them again");
  command.add_option("--ready-file", arguments->ready_path,
                     "created once the first windows can be touched; without it none is");
  command.add_flag("--until-finger-leaves", acquire.until_finger_leaves,
                   "end when the finger has come and gone");
  command
      .add_option("--duration-s", acquire.duration_s,
                  "end after so long; without it the finger's leaving or Ctrl-C ends it")
      ->check(above_zero());
  add_modulus_options(command, acquire.modulus_method, acquire.modulus_time_limit_s);
  add_plane_option(command, acquire.plane, "strain");
  command.add_option("--start-x-m", acquire.start_x_m, "where the finger is expected first")
      ->capture_default_str();
  command.add_option("--start-direction", acquire.start_direction, "1 or -1: where it will go first")
      ->check(CLI::IsMember({1, -1}));
  command.add_option("--lookahead", acquire.planner.lookahead, "windows acquired ahead of the finger")
      ->check(CLI::Range(1, 8))
      ->capture_default_str();
  command.add_option("--refresh-after-s", acquire.planner.refresh_after_s, "older windows are acquired anew")
      ->check(above_zero())
      ->capture_default_str();
  command.callback([arguments] { run(*arguments); });
}

}  // namespace teletact::client
