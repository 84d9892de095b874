#include "client/link/touch_link.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <random>
#include <utility>

#include "client/link/channel.h"
#include "client/link/scenes.h"
#include "client/link/servo_messages.h"

namespace teletact::client {
namespace {

constexpr double kConnectWaitS = 0.05;  // per look at the attempts, and whether to stop
// From this round trip on a guessed law is nearer to the tissue than answers are: at 120 mm/s they are of 4
// mm before.
constexpr double kGuessedFromS = 0.03, kGuessedToS = 0.02;
constexpr unsigned kOlderCredit = 8;  // at most, of services that refuse a wish instead of keeping less

std::uint64_t random_number() {
  std::random_device random;
  return (std::uint64_t{random()} << 32) | random();
}

std::int64_t to_ns(double seconds) {
  return std::llround(seconds * 1e9);
}

std::chrono::steady_clock::duration duration(std::int64_t ns) {
  return std::chrono::nanoseconds(ns);
}

// Refused for what there is now.
bool may_pass_later(grpc::StatusCode code) {
  using enum grpc::StatusCode;
  return code == RESOURCE_EXHAUSTED || code == FAILED_PRECONDITION || code == OUT_OF_RANGE || code == ABORTED;
}

}  // namespace

TouchLink::TouchLink(TouchLinkOptions options, LatestSlot<ServoPose>& poses, LatestSlot<ServoAnswer>& answers,
                     Clock& clock)
    : options_(std::move(options)),
      poses_(poses),
      answers_(answers),
      clock_(clock),
      instance_(random_number()) {
  options_.open.set_laws(options_.laws != nullptr);
  if (options_.open.session_id().empty()) {
    options_.open.set_session_id("touch-" + std::to_string(instance_ % 1'000'000'000));
  }
}

TouchLink::~TouchLink() {
  stop();
}

void TouchLink::start() {
  thread_ = std::thread([this] { run(); });
}

void TouchLink::stop() {
  {
    std::lock_guard lock(mutex_);
    stopping_ = true;
    changed_.notify_all();
  }
  if (thread_.joinable()) thread_.join();
}

TouchLinkStats TouchLink::stats() const {
  std::lock_guard lock(mutex_);
  return received_.stats;
}

std::string TouchLink::trouble() const {
  std::lock_guard lock(mutex_);
  return shared_.opened && !shared_.ended ? "" : last_reason_;
}

bool TouchLink::covered() const {
  std::lock_guard lock(mutex_);
  return received_.covered();
}

std::optional<TactileImage> TouchLink::take_tactile() {
  std::lock_guard lock(mutex_);
  return std::exchange(tactile_, std::nullopt);
}

std::string TouchLink::failure() const {
  std::lock_guard lock(mutex_);
  return failure_;
}

void TouchLink::hand_over(std::string session_id) {
  std::lock_guard lock(mutex_);
  hand_over_to_ = std::move(session_id);
  changed_.notify_all();
}

void TouchLink::pause(double wait_s) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, duration(to_ns(wait_s)), [this] { return stopping_; });
}

void TouchLink::run() {
  const auto stopping = [this] {
    std::lock_guard lock(mutex_);
    return stopping_;
  };
  while (!stopping()) {
    // A new channel each time: an old one may hold on to a half-open connection or a long backoff.
    Connecting connecting(options_.address, options_.credentials);
    std::shared_ptr<grpc::Channel> channel;
    while (!stopping() && !channel) channel = connecting.wait(kConnectWaitS);
    if (stopping()) return;
    const auto stub = v1::Palpation::NewStub(channel);
    const grpc::Status status = serve(*stub);
    if (stopping()) return;
    const std::optional<double> wait_s = retry_after_s(status);
    if (!wait_s) return;
    pause(*wait_s);
  }
}

// None: never. A link that broke is tried again at once, a refusal ever more seldom, until a stream has lived
// for a while.
std::optional<double> TouchLink::retry_after_s(const grpc::Status& status) {
  constexpr std::int64_t kSettledNs = 5'000'000'000;
  std::lock_guard lock(mutex_);
  // What was accepted once may be again: a restarted service reads its scenes first. Meanwhile silence takes
  // the force away.
  const bool never = refused_for_good(status) || status.error_code() == grpc::StatusCode::DATA_LOSS;
  const bool for_good = never && received_.stats.streams == 0;
  const bool refused = never || may_pass_later(status.error_code());
  const std::string reason = describe(status);
  if (refused_for_good(status) && reason.find("open.credit") != std::string::npos &&
      options_.open.credit() > kOlderCredit) {
    options_.open.set_credit(kOlderCredit);
    return 0;
  }
  if (for_good) {
    failure_ = reason;
    changed_.notify_all();
    return std::nullopt;
  }
  if (reason != last_reason_)
    spdlog::warn("touch stream ended ({}), {}", reason,
                 refused ? "trying again, ever more seldom" : "opening it again");
  last_reason_ = reason;
  if (!refused) return kRetryS;
  if (shared_.opened && clock_.now_ns() - shared_.opened_ns > kSettledNs) refused_.restart();
  return refused_.next_s();
}

grpc::Status TouchLink::serve(v1::Palpation::Stub& stub) {
  grpc::ClientContext context;
  name_scene(context, options_.open.scene_id());
  {
    std::lock_guard lock(mutex_);
    shared_ = Shared();
    shared_.heard_ns = clock_.now_ns();
    shared_.answered_sequence = sequence_;
    ++call_;
    gave_up_ = false;
  }
  std::thread guarding([this, &context] { guard(context); });
  const auto stream = stub.Touch(&context);
  if (write_open(*stream)) {
    std::thread reader([this, &stream] { read(*stream); });
    write_poses(*stream);
    reader.join();
  }
  const grpc::Status status = stream->Finish();
  {
    std::lock_guard lock(mutex_);
    shared_.over = true;
    changed_.notify_all();
  }
  guarding.join();
  std::lock_guard lock(mutex_);
  if (!shared_.problem.empty()) return {grpc::StatusCode::DATA_LOSS, shared_.problem};
  return gave_up_ ? grpc::Status(grpc::StatusCode::DEADLINE_EXCEEDED, "the service says nothing") : status;
}

// The stream's calls wait for the peer for as long as it likes; this ends them.
void TouchLink::guard(grpc::ClientContext& context) {
  std::unique_lock lock(mutex_);
  while (!shared_.over) {
    const double dead_s =
        shared_.opened
            ? std::max({options_.dead_s, 10 * received_.stats.period_s, 4 * received_.round_trip_s()})
            : options_.open_wait_s;
    const std::int64_t since_ns =
        shared_.writing_ns == 0 ? shared_.heard_ns : std::min(shared_.heard_ns, shared_.writing_ns);
    const std::int64_t left_ns = since_ns + to_ns(dead_s) - clock_.now_ns();
    if (stopping_ || left_ns <= 0 || !shared_.problem.empty()) {
      gave_up_ = !stopping_;
      lock.unlock();
      context.TryCancel();
      return;
    }
    changed_.wait_for(lock, duration(left_ns));
  }
}

void TouchLink::read(Stream& stream) {
  v1::TouchResponse response;
  while (stream.Read(&response)) {
    const std::int64_t now_ns = clock_.now_ns();
    v1::RecordEntry entry;  // copied before the lock, which the writer of poses waits for
    if (options_.recorder != nullptr) entry = recorded(response, now_ns, call_);
    std::lock_guard lock(mutex_);  // a recording has the link's own order of what was sent and heard
    if (options_.recorder != nullptr) options_.recorder->append(std::move(entry));
    if (response.has_opened()) take_opened(response.opened(), now_ns);
    if (response.has_answer()) take_answer(response.answer(), now_ns);
    if (response.has_law()) take_law(response.law());
  }
  std::lock_guard lock(mutex_);
  shared_.ended = true;
  changed_.notify_all();
}

void TouchLink::take_opened(const v1::TouchOpened& opened, std::int64_t received_ns) {
  if (shared_.opened) return;  // once per stream
  shared_.heard_ns = shared_.opened_ns = received_ns;
  shared_.problem = received_.take_opened(opened, received_ns);
  shared_.opened = shared_.problem.empty();
  law_.open(opened.layer().depth_m());
  tell_law();
  changed_.notify_all();
}

void TouchLink::take_answer(const v1::TouchAnswer& answer, std::int64_t received_ns) {
  if (!shared_.opened) return;  // there is no layer and no period yet
  shared_.heard_ns = received_ns;
  shared_.acknowledged = answer.answer();
  const bool ours = answer.pose_stamp().instance() == instance_ && answer.sequence() <= sequence_;
  const bool recent = ours && sequence_ - answer.sequence() < sent_ns_.size();
  const std::int64_t sent_ns = recent ? sent_ns_[answer.sequence() % sent_ns_.size()] : 0;
  if (const auto converted = received_.take_answer(answer, ours, sent_ns, received_ns)) {
    shared_.answered_sequence = std::max(shared_.answered_sequence, answer.sequence());
    answers_.put(*converted);
    if (answer.has_tactile()) keep_tactile(answer.tactile());
  }
  changed_.notify_all();
}

void TouchLink::keep_tactile(const v1::TactileImage& image) {
  auto read = tactile_from(image);
  if (read) {
    ++received_.stats.tactile_images;
    tactile_ = std::move(read);
  } else if (++received_.stats.tactile_dropped == 1) {
    spdlog::warn("a tactile image was malformed: it is not shown");
  }
}

void TouchLink::take_law(const v1::LawPiece& piece) {
  if (!shared_.opened || options_.laws == nullptr) return;
  shared_.heard_ns = clock_.now_ns();
  if (law_.take(piece, finger_m_.x(), finger_m_.z()))
    ++received_.stats.law_pieces;
  else if (++received_.stats.laws_dropped == 1)
    spdlog::warn("a piece of a contact law was malformed: forces come from answers alone");
  tell_law();
}

// Whose answers are quick feels those sooner than a guess.
void TouchLink::tell_law() {
  if (options_.laws == nullptr) return;
  guesses_ = received_.round_trip_s() > (guesses_ ? kGuessedToS : kGuessedFromS);
  if (const auto law = law_.fresh(finger_m_.x(), finger_m_.z(), guesses_)) options_.laws->put(*law);
}

// True when a pose may be sent now; false when the stream is over.
bool TouchLink::wait_to_send(std::unique_lock<std::mutex>& lock, std::int64_t next_ns) {
  while (true) {
    if (stopping_ || shared_.ended) return false;
    const std::int64_t now_ns = clock_.now_ns();
    const bool has_room = sequence_ - shared_.answered_sequence < received_.pacing.in_flight();
    const double heartbeat_s = std::max(kHeartbeatS, received_.round_trip_s());
    const std::int64_t send_ns = next_ns + (has_room ? 0 : to_ns(heartbeat_s));
    if (!shared_.opened) {
      changed_.wait(lock);
    } else if (now_ns < send_ns) {
      changed_.wait_for(lock, duration(send_ns - now_ns));
    } else {
      return true;
    }
  }
}

bool TouchLink::write_open(Stream& stream) {
  v1::TouchRequest request;
  *request.mutable_open() = options_.open;
  std::unique_lock lock(mutex_);
  return write(stream, request, clock_.now_ns(), lock);
}

void TouchLink::write_poses(Stream& stream) {
  constexpr std::int64_t kLookAgainNs = 250'000;  // for the servo's next pose
  const double by_law_s = options_.open.has_tactile() ? kTactilePeriodS : kLawPeriodS;
  ServoPose pose;
  bool has_pose = false;
  std::int64_t next_ns = clock_.now_ns();
  std::int64_t sent_ns = 0;
  std::unique_lock lock(mutex_);
  while (wait_to_send(lock, next_ns)) {
    if (!hand_over_to_.empty()) {
      v1::TouchRequest request;
      request.mutable_hand_over()->set_session_id(std::exchange(hand_over_to_, ""));
      if (!write(stream, request, clock_.now_ns(), lock)) return;
    }
    const std::int64_t now_ns = clock_.now_ns();
    const bool fresh = poses_.take(pose);
    has_pose = has_pose || fresh;
    // The same pose twice tells the service nothing, unless as a heartbeat.
    if (!has_pose || (!fresh && now_ns - sent_ns < to_ns(kHeartbeatS))) {
      next_ns = now_ns + kLookAgainNs;
      continue;
    }
    // Keeps the average rate when a wake-up is late, without bursts.
    finger_m_ = pose.pose.position_m;
    tell_law();
    const std::int64_t interval_ns =
        to_ns(std::max({received_.pacing.interval_s(), 0.001, pose.by_law ? by_law_s : 0.0}));
    next_ns = std::max(next_ns + interval_ns, now_ns + interval_ns / 2);
    sent_ns = now_ns;
    ++received_.stats.poses;
    sent_ns_[++sequence_ % sent_ns_.size()] = now_ns;
    received_.pacing.sent(sequence_);
    v1::TouchRequest request = to_request(pose, sequence_, shared_.acknowledged, instance_);
    request.mutable_pose()->set_laws_acknowledged(law_.pieces());
    if (!write(stream, request, now_ns, lock)) return;
  }
}

// Called with the lock, which the transport is not waited for with. False: the stream has ended; the reader
// learns of it too, and Finish() says why.
bool TouchLink::write(Stream& stream, const v1::TouchRequest& request, std::int64_t now_ns,
                      std::unique_lock<std::mutex>& lock) {
  if (options_.recorder != nullptr) options_.recorder->append(recorded(request, now_ns, call_));
  shared_.writing_ns = now_ns;
  lock.unlock();
  const bool written = stream.Write(request);
  lock.lock();
  shared_.writing_ns = 0;
  return written;
}

}  // namespace teletact::client
