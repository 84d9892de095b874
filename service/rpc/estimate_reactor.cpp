#include "service/rpc/estimate_reactor.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include "service/rpc/call_metadata.h"
#include "service/rpc/estimate_answer.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

using Seconds = std::chrono::duration<double>;

// The call's own, on our clock; never, where it has none.
JobTerms::Time deadline_of(const grpc::CallbackServerContext& context) {
  constexpr double kFar = 86400;
  const double left_s = Seconds(context.deadline() - std::chrono::system_clock::now()).count();
  return left_s < kFar ? JobTerms::Time::clock::now() + seconds(left_s) : JobTerms::Time::max();
}

}  // namespace

EstimateReactor::EstimateReactor(Core& core, grpc::CallbackServerContext* context)
    : ServedCall(core, context, "teletact.v1.Elastography/Estimate"),
      core_(core),
      whole_upload_s_(core.limits.min_upload_s) {}

EstimateReactor* EstimateReactor::serve(Core& core, grpc::CallbackServerContext* context) {
  return ServedCall::serve(std::make_shared<EstimateReactor>(core, context), CallKind::kEstimate,
                           client_of(*context));
}

void EstimateReactor::begun() {
  begun_ = true;
  StartRead(&message_);
}

void EstimateReactor::OnReadDone(bool ok) {
  during([&] {
    if (!ok) return uploaded();
    receive();
    StartRead(&message_);
  });
}

void EstimateReactor::receive() {
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
    core_.imaging.lane_for(*request_, terms()).refuse_the_hopeless(*request_, terms());
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
void EstimateReactor::require_authority(const v1::Acquisition& in) {
  if (in.has_publish() || !in.has_slice_of()) require({Need::kPublish, in.publish().scene_id()});
  if (in.has_slice_of()) require({Need::kPublish, in.slice_of().scene_id()});
}

JobTerms EstimateReactor::terms() const {
  return {.client = client_of(*context_), .deadline = deadline_of(*context_)};
}

// The client has closed its side: the pair is whole, or refused.
void EstimateReactor::uploaded() {
  if (context_->IsCancelled()) throw Error(ErrorKind::kCancelled, "the upload was cut");
  if (!request_)
    throw std::invalid_argument("acquisition: the first message of a call must be the acquisition");
  upload_->require_whole();
  received_ = Clock::now();
  over("upload");
  lane_ = &core_.imaging.lane_for(*request_, terms());
  admitted_ = lane_->admit(*request_, terms());
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

void EstimateReactor::work() {
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

void EstimateReactor::log_done() const {
  const Estimate& e = outcome_->estimate;
  spdlog::info(
      "event=estimate_done call={} peer={} valid={:.3f} correlation={:.3f} warnings={} elapsed_s={:.4f}",
      id(), context_->peer(), e.valid_fraction, e.median_correlation,
      e.input_warnings.size() + e.modulus.warnings.size(), Seconds(Clock::now() - received_).count());
  for (const std::string& warning : e.input_warnings)
    spdlog::warn("event=estimate_doubtful call={} flag=input text=\"{}\"", id(), warning);
  for (const ModulusWarning& warning : e.modulus.warnings)
    spdlog::warn("event=estimate_doubtful call={} flag={} text=\"{}\"", id(), name_of(warning.flag),
                 warning.text);
}

void EstimateReactor::worked(const std::exception_ptr& error) {
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

void EstimateReactor::progressed(v1::EstimateStage stage) {
  {
    const std::lock_guard lock(mutex_);
    v1::EstimateProgress& progress = progress_.emplace_back();
    progress.set_stage(stage);
    progress.set_elapsed_s(Seconds(Clock::now() - received_).count());
  }
  go_on();
}

void EstimateReactor::over(const char* stage) {
  const std::lock_guard lock(mutex_);
  over_.emplace_back(stage, Clock::now());
}

std::vector<StageTime> EstimateReactor::stages() const {
  const std::lock_guard lock(mutex_);
  std::vector<StageTime> stages;
  Clock::time_point begin = opened_;
  for (const auto& [name, end] : over_) {
    stages.push_back({name, end - begin});
    begin = end;
  }
  return stages;
}

// The next message into answer_; false when there is none yet, or none any more.
bool EstimateReactor::next_message() {
  answer_.Clear();
  if (!progress_.empty()) {
    *answer_.mutable_progress() = std::move(progress_.front());
    progress_.pop_front();
    return true;
  }
  return worked_ && answer_to(*outcome_, *request_, written_++, &answer_);
}

void EstimateReactor::go_on() {
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

void EstimateReactor::OnWriteDone(bool ok) {
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

void EstimateReactor::tick(Clock::time_point now) {
  calls_.require_staying();
  const Limits& limits = core_.limits;
  const std::lock_guard lock(mutex_);
  if (uploading_ && now - last_bytes_ > Seconds(limits.upload_idle_s))
    throw Error(ErrorKind::kDeadline,
                fmt::format("chunk.data: no bytes for {} s; send without a pause, or open another call",
                            limits.upload_idle_s));
  if (uploading_ && now - opened_ > Seconds(whole_upload_s_))
    throw Error(ErrorKind::kDeadline,
                fmt::format("chunk.data: the upload is not whole after {:.0f} s; use a faster link, or send "
                            "a smaller frame",
                            whole_upload_s_));
  if (writing_since_ && now - *writing_since_ > Seconds(limits.answer_taken_s))
    throw Error(ErrorKind::kDeadline,
                fmt::format("the answer was not read for {} s; read it, or ask for fewer maps",
                            limits.answer_taken_s));
}

void EstimateReactor::ended() {
  Workers::Id job = 0;
  {
    const std::lock_guard lock(mutex_);
    if (!worked_) job = job_;
  }
  core_.imaging.workers().cancel(job);  // worked() comes at its next look, or at once
}

void EstimateReactor::closed() {
  const grpc::Status status = life().status();
  if (begun_ && !status.ok())
    spdlog::info("event=estimate_ended call={} peer={} code={} error=\"{}\"", id(), context_->peer(),
                 static_cast<int>(status.error_code()), status.error_message());
}

}  // namespace teletact::service
