#include "service/rpc/elastography_service.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <tuple>

#include "service/rpc/status.h"
#include "service/rpc/wait.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point then) {
  return std::chrono::duration<double>(Clock::now() - then).count();
}

v1::EstimateStage stage_to(Stage stage) {
  switch (stage) {
    case Stage::kDisplacement:
      return v1::ESTIMATE_STAGE_DISPLACEMENT;
    case Stage::kStrain:
      return v1::ESTIMATE_STAGE_STRAIN;
    case Stage::kModulus:
      return v1::ESTIMATE_STAGE_MODULUS;
  }
  return v1::ESTIMATE_STAGE_UNSPECIFIED;
}

using Stream = grpc::ServerReaderWriter<v1::EstimateResponse, v1::EstimateRequest>;

void write_progress(Stream& stream, v1::EstimateStage stage, double elapsed_s) {
  v1::EstimateResponse response;
  response.mutable_progress()->set_stage(stage);
  response.mutable_progress()->set_elapsed_s(elapsed_s);
  stream.Write(response);
}

// Progress from the imaging worker to the handler, which alone writes: a client that does not read must not
// hold up imaging. At most one entry per stage.
class Progress {
 public:
  struct Step {
    v1::EstimateStage stage;
    double elapsed_s;
  };
  void ended(v1::EstimateStage stage, double elapsed_s) {
    {
      const std::lock_guard lock(mutex_);
      steps_.push_back({stage, elapsed_s});
    }
    changed_.notify_one();
  }
  void finished() {
    {
      const std::lock_guard lock(mutex_);
      finished_ = true;
    }
    changed_.notify_one();
  }
  // The next step; empty after finished() or when nothing came for a while.
  std::optional<Step> next(bool& finished) {
    constexpr std::chrono::milliseconds kLook{20};
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, kLook, [this] { return finished_ || !steps_.empty(); });
    finished = finished_ && steps_.empty();
    if (steps_.empty()) return std::nullopt;
    const Step step = steps_.front();
    steps_.pop_front();
    return step;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Step> steps_;
  bool finished_ = false;
};

// Says that the work has ended, however it ends.
struct Finisher {
  Progress& progress;
  ~Finisher() { progress.finished(); }
};

void map_to(const Estimate& e, const std::string& name, v1::Map* out) {
  out->set_name(name);
  v1::Grid* grid = out->mutable_grid();
  grid->add_size(static_cast<std::uint32_t>(e.grid.nx)),
      grid->add_size(static_cast<std::uint32_t>(e.grid.ny));
  grid->add_origin_m(e.grid.origin_x_m), grid->add_origin_m(e.grid.origin_y_m);
  grid->add_spacing_m(e.grid.dx_m), grid->add_spacing_m(e.grid.dy_m);
  v1::Array* array = out->mutable_values();
  array->add_shape(static_cast<std::uint32_t>(e.grid.ny)),
      array->add_shape(static_cast<std::uint32_t>(e.grid.nx));
  const auto fill = [&](const Field& field, const char* unit) {
    out->set_unit(unit);
    array->set_dtype(v1::DATA_TYPE_FLOAT32);
    array->set_data(field.data(), field.size() * sizeof(float));
  };
  if (name == "axial_displacement") return fill(e.axial_displacement, "m");
  if (name == "lateral_displacement") return fill(e.lateral_displacement, "m");
  if (name == "axial_displacement_std") return fill(e.axial_displacement_std, "m");
  if (name == "lateral_displacement_std") return fill(e.lateral_displacement_std, "m");
  if (name == "axial_strain_std") return fill(e.axial_strain_std, "1");
  if (name == "lateral_strain_std") return fill(e.lateral_strain_std, "1");
  if (name == "shear_strain_std") return fill(e.shear_strain_std, "1");
  if (name == "axial_strain") return fill(e.axial_strain, "1");
  if (name == "lateral_strain") return fill(e.lateral_strain, "1");
  if (name == "shear_strain") return fill(e.shear_strain, "1");
  if (name == "correlation") return fill(e.correlation, "1");
  if (name == "youngs_modulus") return fill(e.youngs_modulus, e.modulus_absolute ? "Pa" : "1");
  if (name == "youngs_modulus_log_std") return fill(e.modulus_log_deviation, "1");
  out->set_unit("1");  // valid
  array->set_dtype(v1::DATA_TYPE_UINT8);
  array->set_data(e.valid.data(), e.valid.size());
}

}  // namespace

// Everything the worker needs; it may outlive the handler. Whoever claims the frames first uses them: the
// worker when it begins, or a handler that gives up, which frees them. (Otherwise clients that upload and
// cancel would fill the worker's queue with frames that nobody counts.)
struct ElastographyService::Job {
  EstimateRequest request;
  RfFrame pre, post;
  Clock::time_point received;
  Progress progress;
  Abandoned abandoned = not_abandoned();
  std::atomic<bool> claimed{false};
  bool claim() { return !claimed.exchange(true); }
  void drop_frames() {
    if (claim()) pre = {}, post = {};
  }
};

struct ElastographyService::Outcome {
  teletact::service::Estimate estimate;
  std::optional<Published> published;
  double publish_s = 0, received_to_published_s = 0, queued_s = 0;
};

ElastographyService::ElastographyService(Core& core) : core_(core) {}

void ElastographyService::warm() {
  core_.scenes.worker()
      .run([this] {
        engine_ = std::make_unique<Elastography>(core_.device);
        engine_->warm();
      })
      .get();
}

Elastography& ElastographyService::engine_for(double max_strain) {
  if (max_strain == kDefaultMaxStrain) return *engine_;
  if (!other_engine_ || other_max_strain_ != max_strain) {
    ElastographyOptions options;
    options.displacement.max_strain = max_strain;
    other_engine_ = std::make_unique<Elastography>(core_.device, options);
    other_max_strain_ = max_strain;
  }
  return *other_engine_;
}

ElastographyService::Outcome ElastographyService::work(Job& job) {
  const Finisher finisher{job.progress};
  const auto cancelled = [&job] { return job.abandoned->load(); };
  if (cancelled() || !job.claim()) throw Error(ErrorKind::kCancelled, "the caller cancelled");
  const EstimateRequest& r = job.request;
  Outcome outcome;
  outcome.queued_s = seconds_since(job.received);
  // What lies beside the window draws stress to itself: the scene tells what it knows of it by now.
  const KnownModulus known = r.scene ? known_modulus(r.scene->snapshot()->map) : KnownModulus{};
  try {
    outcome.estimate =
        engine_for(r.max_strain)
            .estimate(
                job.pre, job.post, r.geometry, r.force, r.tissue,
                [&job](Stage stage) { job.progress.ended(stage_to(stage), seconds_since(job.received)); },
                cancelled, known, r.modulus);
  } catch (const TrackingError& error) {
    throw Error(ErrorKind::kPrecondition, error.what());
  } catch (const EstimateCancelled& error) {
    throw Error(ErrorKind::kCancelled, error.what());
  }
  if (!r.scene) return outcome;
  const auto begun = Clock::now();
  outcome.published = core_.scenes.publish(r.scene, window_of(r, outcome.estimate, job.received), cancelled);
  outcome.publish_s = seconds_since(begun);
  outcome.received_to_published_s = seconds_since(job.received);
  job.progress.ended(v1::ESTIMATE_STAGE_PUBLISHED, outcome.received_to_published_s);
  return outcome;
}

// Cuts a call whose client has said nothing for too long.
class ElastographyService::Guard : public Served {
 public:
  Guard(grpc::ServerContext* context, double idle_s) : context_(context), idle_(seconds(idle_s)) {}
  void heard() { heard_ = Clock::now(); }
  void leave() {
    const std::lock_guard lock(mutex_);
    context_ = nullptr;
  }
  void look(Clock::time_point now) override {
    const std::lock_guard lock(mutex_);
    if (context_ && now - heard_.load() > idle_) context_->TryCancel();
  }

 private:
  std::mutex mutex_;
  grpc::ServerContext* context_;
  const Clock::duration idle_;
  std::atomic<Clock::time_point> heard_{Clock::now()};
};

// Reads the whole upload. Throws; nothing is kept then.
void ElastographyService::receive(Stream& stream, Core& core, Guard& guard, Job& job) {
  v1::EstimateRequest message;
  if (!stream.Read(&message) || !message.has_acquisition())
    throw std::invalid_argument("acquisition: the first message of a call must be the acquisition");
  job.request = request_from(message.acquisition(), core.scenes, core.limits);
  FrameUpload upload(job.request, core.limits.most_chunk_bytes);
  while (stream.Read(&message)) {
    guard.heard();
    if (!message.has_chunk())
      throw std::invalid_argument("chunk: after the acquisition only chunks may follow");
    upload.add(message.chunk());
  }
  std::tie(job.pre, job.post) = upload.finish();
}

namespace {

v1::ModulusMethod method_to(ModulusKind kind) {
  switch (kind) {
    case ModulusKind::kReferenceStress:
      return v1::MODULUS_METHOD_REFERENCE_STRESS;
    case ModulusKind::kDirect:
      return v1::MODULUS_METHOD_DIRECT;
    case ModulusKind::kIterative:
      return v1::MODULUS_METHOD_ITERATIVE;
  }
  return v1::MODULUS_METHOD_UNSPECIFIED;
}

void summary_to(const Estimate& e, v1::EstimateSummary* out) {
  out->set_modulus_absolute(e.modulus_absolute);
  out->set_median_correlation(e.median_correlation);
  out->set_quality(e.quality);
  out->set_valid_fraction(e.valid_fraction);
  out->set_mean_axial_strain(e.mean_axial_strain);
  out->set_background_modulus_pa(e.background_modulus);
  out->set_modulus_method(method_to(e.modulus_kind));
  out->set_modulus_converged(e.modulus_converged);
  out->set_modulus_iterations(static_cast<std::uint32_t>(e.modulus_iterations));
  for (const std::string& warning : warnings_of(e)) out->add_warnings(warning);
}

void add_stage(v1::EstimateSummary* summary, const char* name, double s) {
  v1::StageTime* time = summary->add_stages();
  time->set_stage(name);
  time->set_seconds(s);
}

}  // namespace

void ElastographyService::write_outcome(const Outcome& outcome, const EstimateRequest& request,
                                        Stream& stream) {
  const teletact::service::Estimate& e = outcome.estimate;
  v1::EstimateResponse response;
  for (const std::string& name : request.maps) {
    map_to(e, name, response.mutable_map()->mutable_map());
    stream.Write(response);
    response.Clear();
  }
  v1::EstimateSummary* summary = response.mutable_summary();
  summary_to(e, summary);
  add_stage(summary, "queued", outcome.queued_s);
  add_stage(summary, "displacement", e.displacement_s);
  add_stage(summary, "strain", e.strain_s);
  add_stage(summary, "modulus", e.modulus_s);
  if (outcome.published) {
    for (const std::string& warning : outcome.published->warnings) summary->add_warnings(warning);
    add_stage(summary, "publish", outcome.publish_s);
    summary->set_scene_id(request.scene->id());
    summary->set_window_id(outcome.published->window_id);
    summary->set_scene_version(outcome.published->version);
    summary->set_received_to_published_s(outcome.received_to_published_s);
  }
  stream.Write(response);
}

grpc::Status ElastographyService::Estimate(grpc::ServerContext* context, Stream* stream) {
  return guarded([&] {
    // A stalled upload is cut; one that has arrived is finished within the drain's time.
    struct Leaver {
      std::shared_ptr<Guard> guard;
      ~Leaver() { guard->leave(); }
    } const leaver{std::make_shared<Guard>(context, core_.limits.upload_idle_s)};
    const auto ticket = core_.calls.enter(CallKind::kEstimate, leaver.guard);
    auto job = std::make_shared<Job>();
    try {
      receive(*stream, core_, *leaver.guard, *job);
    } catch (const std::exception& error) {
      spdlog::info("event=estimate_refused call={} peer={} error=\"{}\"", ticket->id(), context->peer(),
                   error.what());
      throw;
    }
    if (context->IsCancelled()) throw Error(ErrorKind::kCancelled, "the upload was cut");
    job->received = Clock::now();
    write_progress(*stream, v1::ESTIMATE_STAGE_RECEIVED, 0);
    auto future = core_.scenes.worker().run([this, job] { return work(*job); });
    for (bool finished = false; !finished && !context->IsCancelled();) {
      leaver.guard->heard();
      if (const auto step = job->progress.next(finished))
        write_progress(*stream, step->stage, step->elapsed_s);
    }
    const Outcome outcome = [&] {
      try {
        return wait_for(future, *context, job->abandoned);
      } catch (...) {
        job->drop_frames();
        throw;
      }
    }();
    write_outcome(outcome, job->request, *stream);
    const auto& e = outcome.estimate;
    spdlog::info(
        "event=estimate_done call={} peer={} valid={:.3f} correlation={:.3f} warnings={} elapsed_s={:.4f}",
        ticket->id(), context->peer(), e.valid_fraction, e.median_correlation,
        e.input_warnings.size() + e.modulus_warnings.size(), seconds_since(job->received));
    for (const std::string& warning : e.input_warnings)
      spdlog::warn("event=estimate_doubtful call={} flag=input text=\"{}\"", ticket->id(), warning);
    for (const ModulusWarning& warning : e.modulus_warnings)
      spdlog::warn("event=estimate_doubtful call={} flag={} text=\"{}\"", ticket->id(), name_of(warning.flag),
                   warning.text);
    return grpc::Status::OK;
  });
}

}  // namespace teletact::service
