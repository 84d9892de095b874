#include "service/rpc/services.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "service/base/memory.h"
#include "service/rpc/call_metadata.h"
#include "service/rpc/core.h"
#include "service/rpc/estimate_messages.h"
#include "service/rpc/served_call.h"
#include "service/scene/errors.h"
#include "teletact/v1/elastography.grpc.pb.h"

namespace teletact::service {

namespace {

using Seconds = std::chrono::duration<double>;

// The call's own, on our clock; never, where it has none.
JobTerms::Time deadline_of(const grpc::CallbackServerContext& context) {
  constexpr double kFar = 86400;
  const double left_s = Seconds(context.deadline() - std::chrono::system_clock::now()).count();
  return left_s < kFar ? JobTerms::Time::clock::now() + seconds(left_s) : JobTerms::Time::max();
}

// One Estimate call. gRPC's threads put its upload together; the imaging plane works on it; the answer is
// written message by message, one in flight. No thread belongs to the call, and each of its waits has an end.
class EstimateReactor final
    : public ServedCall<grpc::ServerBidiReactor<v1::EstimateRequest, v1::EstimateResponse>> {
 public:
  EstimateReactor(Core& core, grpc::CallbackServerContext* context)
      : ServedCall(core, context, "teletact.v1.Elastography/Estimate"),
        core_(core),
        whole_upload_s_(core.limits.min_upload_s) {}
  static EstimateReactor* serve(Core& core, grpc::CallbackServerContext* context) {
    return ServedCall::serve(std::make_shared<EstimateReactor>(core, context), CallKind::kEstimate,
                             client_of(*context));
  }

 private:
  void begun() override {
    begun_ = true;
    StartRead(&message_);
  }
  void tick(Clock::time_point now) override {
    calls_.require_staying();
    const Limits& limits = core_.limits;
    const std::lock_guard lock(mutex_);
    if (uploading_ && now - last_bytes_ > Seconds(limits.upload_idle_s))
      throw Error(ErrorKind::kDeadline,
                  fmt::format("chunk.data: no bytes for {} s; send without a pause, or open another call",
                              limits.upload_idle_s));
    if (uploading_ && now - opened_ > Seconds(whole_upload_s_))
      throw Error(
          ErrorKind::kDeadline,
          fmt::format("chunk.data: the upload is not whole after {:.0f} s; use a faster link, or send "
                      "a smaller frame",
                      whole_upload_s_));
    if (writing_since_ && now - *writing_since_ > Seconds(limits.answer_taken_s))
      throw Error(ErrorKind::kDeadline,
                  fmt::format("the answer was not read for {} s; read it, or ask for fewer maps",
                              limits.answer_taken_s));
  }
  void ended() override {
    Workers::Id job = 0;
    {
      const std::lock_guard lock(mutex_);
      if (!worked_) job = job_;
    }
    core_.imaging.workers().cancel(job);  // worked() comes at its next look, or at once
  }
  void closed() override {
    const grpc::Status status = life().status();
    if (begun_ && !status.ok())
      spdlog::info("event=estimate_ended call={} peer={} code={} error=\"{}\"", id(), context_->peer(),
                   static_cast<int>(status.error_code()), status.error_message());
  }
  std::vector<StageTime> stages() const override {
    const std::lock_guard lock(mutex_);
    std::vector<StageTime> stages;
    Clock::time_point begin = opened_;
    for (const auto& [name, end] : over_) {
      stages.push_back({name, end - begin});
      begin = end;
    }
    return stages;
  }
  void OnReadDone(bool ok) override {
    during([&] {
      if (!ok) return uploaded();
      receive();
      StartRead(&message_);
    });
  }
  void OnWriteDone(bool ok) override {
    {
      const std::lock_guard lock(mutex_);
      writing_since_.reset();
    }
    if (ok)
      during([this] { go_on(); });
    else
      end(grpc::Status::CANCELLED);
    release();
  }

  void receive() {
    const Limits& limits = core_.limits;
    if (!request_) {
      if (!message_.has_acquisition())
        throw std::invalid_argument("acquisition: the first message of a call must be the acquisition");
      require_authority(message_.acquisition());
      if (message_.acquisition().has_publish())
        require_named(*context_, message_.acquisition().publish().scene_id());
      if (message_.acquisition().has_slice_of())
        require_named(*context_, message_.acquisition().slice_of().scene_id());
      core_.imaging.require_device();
      request_ = request_from(message_.acquisition(), core_.scenes, limits);
      JobTerms asked = terms();
      core_.imaging.lane_for(*request_, asked).refuse_the_hopeless(*request_, asked);
      upload_.emplace(*request_, message_.acquisition().dtype(), limits.max_chunk_bytes);
      // As it comes, and as samples.
      upload_bytes_ = core_.account(client_of(*context_))
                          .charge(Place::kHost, "uploads",
                                  2 * (upload_->frame_bytes() + sizeof(float) * request_->samples()));
      const std::lock_guard lock(mutex_);
      whole_upload_s_ += 2 * static_cast<double>(upload_->frame_bytes()) / limits.min_upload_rate;
      return;
    }
    if (!message_.has_chunk())
      throw std::invalid_argument("chunk: after the acquisition only chunks may follow");
    upload_->add(message_.chunk());
    const std::lock_guard lock(mutex_);
    if (!message_.chunk().data().empty()) last_bytes_ = Clock::now();  // an empty one is no progress
  }
  // An estimate that is for no scene takes the role for any.
  void require_authority(const v1::Acquisition& in) {
    if (in.has_publish() || !in.has_slice_of()) require({Need::kPublish, in.publish().scene_id()});
    if (in.has_slice_of()) require({Need::kPublish, in.slice_of().scene_id()});
  }
  // The client has closed its side: the pair is whole, or refused.
  void uploaded() {
    if (context_->IsCancelled()) throw Error(ErrorKind::kCancelled, "the upload was cut");
    if (!request_)
      throw std::invalid_argument("acquisition: the first message of a call must be the acquisition");
    upload_->require_whole();
    received_ = Clock::now();
    over("upload");
    JobTerms asked = terms();
    lane_ = &core_.imaging.lane_for(*request_, asked);
    admitted_ = lane_->admit(*request_, asked);
    {
      const std::lock_guard lock(mutex_);
      uploading_ = false;
    }
    progressed(v1::ESTIMATE_STAGE_RECEIVED);
    if (!hold()) return;
    try {
      const Workers::Id job = core_.imaging.workers().post(
          admitted_, [this] { work(); }, [this](std::exception_ptr error) { worked(std::move(error)); });
      const std::lock_guard lock(mutex_);
      job_ = job;
    } catch (...) {
      release();
      throw;
    }
    if (life().ended()) ended();  // before the job was known
  }
  // Whose call, and by when.
  JobTerms terms() const { return {.client = client_of(*context_), .deadline = deadline_of(*context_)}; }

  // On the imaging plane.
  void work() {
    over("queued");
    const auto frames = [this] {
      auto frames = upload_->finish();
      upload_.reset();
      upload_bytes_.shrink(2 * sizeof(float) * request_->samples());
      return frames;
    };
    outcome_ = lane_->estimate(*request_, admitted_, received_, frames, [this](Stage stage) {
      over(name_of(stage));
      progressed(stage_to(stage));
    });
    core_.metrics.estimate(*outcome_);
    if (outcome_->published) {
      over("publish");
      progressed(v1::ESTIMATE_STAGE_PUBLISHED);
    }
    log_done();
  }
  void log_done() const {
    const Estimate& e = outcome_->estimate;
    spdlog::info(
        "event=estimate_done call={} peer={} valid={:.3f} correlation={:.3f} warnings={} elapsed_s={:.4f}",
        id(), context_->peer(), e.valid_fraction, e.median_correlation,
        e.input_warnings.size() + e.modulus.warnings.size(), Seconds(Clock::now() - received_).count());
    for (const auto& warnings : {e.input_warnings, e.modulus.warnings})
      for (const Warning& warning : warnings)
        spdlog::warn("event=estimate_doubtful call={} flag={} text=\"{}\"", id(), name_of(warning.flag),
                     warning.text);
  }
  void worked(const std::exception_ptr& error) {
    upload_.reset();
    upload_bytes_ = {};
    if (error) {
      end(status_of(error));
    } else {
      {
        const std::lock_guard lock(mutex_);
        worked_ = true;
      }
      during([this] { go_on(); });  // nobody above takes what it throws: there may be no room for the answer
    }
    release();
  }
  void progressed(v1::EstimateStage stage) {
    {
      const std::lock_guard lock(mutex_);
      v1::EstimateProgress& progress = progress_.emplace_back();
      progress.set_stage(stage);
      progress.set_elapsed_s(Seconds(Clock::now() - received_).count());
    }
    go_on();
  }
  // The stage of this name is over.
  void over(const char* stage) {
    const std::lock_guard lock(mutex_);
    over_.emplace_back(stage, Clock::now());
  }
  // Writes what is to be written next, if nothing is in flight; ends the call after the last of it.
  void go_on() {
    bool last = false;
    {
      const std::lock_guard lock(mutex_);
      if (writing_since_) return;
      if (next_message()) {
        if (!hold()) return;
        writing_since_ = Clock::now();
        StartWrite(&answer_);
        return;
      }
      last = worked_;
    }
    if (!last) return;
    over("answer");
    end(grpc::Status::OK);
  }
  // The next message into answer_; false when there is none yet, or none any more.
  bool next_message() {
    answer_.Clear();
    if (!progress_.empty()) {
      *answer_.mutable_progress() = std::move(progress_.front());
      progress_.pop_front();
      return true;
    }
    return worked_ && answer_to(*outcome_, *request_, written_++, &answer_);
  }

  Core& core_;
  const Clock::time_point opened_ = Clock::now();
  bool begun_ = false;  // it has its place

  // gRPC's reading thread; the imaging plane's from uploaded() on.
  v1::EstimateRequest message_;
  std::optional<EstimateRequest> request_;
  Charge upload_bytes_;
  std::optional<FrameUpload> upload_;
  Clock::time_point received_{};
  ImagingLane* lane_ = nullptr;  // where it is worked on
  JobTerms admitted_;            // of its job
  std::optional<EstimateOutcome> outcome_;

  mutable std::mutex mutex_;                                     // what follows
  std::vector<std::pair<const char*, Clock::time_point>> over_;  // stages, one after the other
  bool uploading_ = true, worked_ = false;
  double whole_upload_s_;  // at most, by what the acquisition declares
  Clock::time_point last_bytes_ = opened_;
  Workers::Id job_ = 0;
  std::deque<v1::EstimateProgress> progress_;
  std::size_t written_ = 0;      // messages of the outcome
  v1::EstimateResponse answer_;  // gRPC's, while a write is in flight
  std::optional<Clock::time_point> writing_since_;
};

class ElastographyService final : public v1::Elastography::CallbackService {
 public:
  explicit ElastographyService(Core& core) : core_(core) {}
  grpc::ServerBidiReactor<v1::EstimateRequest, v1::EstimateResponse>* Estimate(
      grpc::CallbackServerContext* context) override {
    return EstimateReactor::serve(core_, context);
  }

 private:
  Core& core_;
};

}  // namespace

std::unique_ptr<grpc::Service> elastography_service(Core& core) {
  return std::make_unique<ElastographyService>(core);
}

}  // namespace teletact::service
