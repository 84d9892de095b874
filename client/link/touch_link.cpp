#include "client/link/touch_link.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <random>

#include "client/link/channel.h"
#include "client/link/convert.h"

namespace teletact::client {
namespace {

constexpr double kConnectWaitS = 0.05;  // per look at the attempts, and whether to stop
constexpr double kRetryS = 0.1;         // between streams that the service refused

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

}  // namespace

TouchLink::TouchLink(TouchLinkOptions options, LatestSlot<ServoPose>& poses, LatestSlot<ServoAnswer>& answers,
                     Clock& clock)
    : options_(std::move(options)),
      poses_(poses),
      answers_(answers),
      clock_(clock),
      instance_(random_number()) {
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
  return stats_;
}

std::string TouchLink::trouble() const {
  std::lock_guard lock(mutex_);
  return shared_.opened && !shared_.ended ? "" : last_reason_;
}

bool TouchLink::covered() const {
  std::lock_guard lock(mutex_);
  return covered_;
}

std::string TouchLink::failure() const {
  std::lock_guard lock(mutex_);
  return failure_;
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
    Connecting connecting(options_.address, options_.tls_ca);
    std::shared_ptr<grpc::Channel> channel;
    while (!stopping() && !channel) channel = connecting.wait(kConnectWaitS);
    if (stopping()) return;
    const auto stub = v1::Palpation::NewStub(channel);
    const grpc::Status status = serve(*stub);
    if (stopping()) return;
    if (!should_retry(status)) return;
    pause(kRetryS);
  }
}

bool TouchLink::should_retry(const grpc::Status& status) {
  std::lock_guard lock(mutex_);
  const auto code = status.error_code();
  const bool refused = code == grpc::StatusCode::INVALID_ARGUMENT || code == grpc::StatusCode::NOT_FOUND ||
                       code == grpc::StatusCode::UNIMPLEMENTED ||
                       code == grpc::StatusCode::PERMISSION_DENIED ||
                       code == grpc::StatusCode::UNAUTHENTICATED;
  // What was accepted once may be again: a restarted service reads its scenes first, and a pose that it
  // refused (beside the tissue) is over as soon as the finger is back; meanwhile silence takes the force
  // away.
  if (refused && stats_.streams == 0) {
    failure_ = describe(status);
    changed_.notify_all();
    return false;
  }
  const std::string reason = describe(status);
  if (reason != last_reason_) spdlog::warn("touch stream ended ({}), opening it again", reason);
  last_reason_ = reason;
  return true;
}

grpc::Status TouchLink::serve(v1::Palpation::Stub& stub) {
  grpc::ClientContext context;
  const auto stream = stub.Touch(&context);
  {
    std::lock_guard lock(mutex_);
    shared_ = Shared();
    shared_.heard_ns = clock_.now_ns();
    shared_.answered_sequence = sequence_;
    ++call_;
    gave_up_ = false;
  }
  v1::TouchRequest open;
  *open.mutable_open() = options_.open;
  v1::RecordEntry entry;
  *entry.mutable_touch_request() = open;
  record(std::move(entry), clock_.now_ns());
  if (stream->Write(open)) {
    std::thread reader([this, &stream] { read(*stream); });
    write(*stream, context);
    reader.join();
  }
  const grpc::Status status = stream->Finish();
  std::lock_guard lock(mutex_);
  return gave_up_ ? grpc::Status(grpc::StatusCode::DEADLINE_EXCEEDED, "the service says nothing") : status;
}

void TouchLink::read(Stream& stream) {
  v1::TouchResponse response;
  while (stream.Read(&response)) {
    const std::int64_t now_ns = clock_.now_ns();
    if (response.has_opened()) take_opened(response.opened());
    if (response.has_answer()) take_answer(response.answer(), now_ns);
    v1::RecordEntry entry;
    *entry.mutable_touch_response() = response;
    record(std::move(entry), now_ns);
  }
  std::lock_guard lock(mutex_);
  shared_.ended = true;
  changed_.notify_all();
}

void TouchLink::take_opened(const v1::TouchOpened& opened) {
  std::lock_guard lock(mutex_);
  shared_.opened = true;
  shared_.heard_ns = clock_.now_ns();
  credit_ = std::max(opened.credit(), 1U);
  stats_.period_s = opened.period_s();
  stats_.line_y_m = opened.line_y_m();
  ++stats_.streams;
  if (opened.instance() != service_instance_) {
    if (service_instance_ != 0) spdlog::warn("the service was restarted");
    service_instance_ = opened.instance();
    clock_offset_.reset();
    ++stats_.instances;
  }
  if (stats_.streams > 1) spdlog::info("touch stream open again, line at y = {:.4f} m", opened.line_y_m());
  changed_.notify_all();
}

void TouchLink::take_answer(const v1::TouchAnswer& answer, std::int64_t received_ns) {
  std::lock_guard lock(mutex_);
  shared_.heard_ns = received_ns;
  shared_.acknowledged = answer.answer();
  ++stats_.answers;
  auto converted = to_servo_answer(answer, stats_.line_y_m, stats_.period_s, received_ns);
  const bool ours = answer.pose_stamp().instance() == instance_ && answer.sequence() <= sequence_;
  if (!converted || !ours) {
    ++stats_.dropped;
    changed_.notify_all();
    return;
  }
  shared_.answered_sequence = std::max(shared_.answered_sequence, answer.sequence());
  take_stamps(answer, *converted);
  if (!converted->has_force && answer.status() != v1::TOUCH_STATUS_PREPARING) ++stats_.failed;
  if (answer.status() == v1::TOUCH_STATUS_DEGRADED) ++stats_.degraded;
  log_warning(answer, received_ns);
  covered_ = converted->covered;
  if (!covered_) ++stats_.not_covered;
  stats_.largest_strain = std::max(stats_.largest_strain, answer.largest_strain());
  if (converted->sample.position_m != last_position_m_) {
    ++stats_.distinct;
    stats_.latencies_s.add(1e-9 * static_cast<double>(received_ns - answer.pose_stamp().monotonic_ns()));
  }
  last_position_m_ = converted->sample.position_m;
  stats_.last_version = answer.model_version();
  stats_.last_answer_s = 1e-9 * static_cast<double>(received_ns);
  if (stats_.first_answer_s == 0) stats_.first_answer_s = stats_.last_answer_s;
  answers_.put(*converted);
  changed_.notify_all();
}

// The pose left at sent_ns_, came to the service `queued` and `compute` before its answer left there.
void TouchLink::take_stamps(const v1::TouchAnswer& answer, ServoAnswer& converted) {
  const std::int64_t left_ns = answer.answer_stamp().monotonic_ns();
  const bool recent = sequence_ - answer.sequence() < sent_ns_.size();
  if (answer.answer_stamp().instance() != service_instance_ || left_ns == 0 || !recent) return;
  const std::int64_t stayed_ns = answer.queued_ns() + answer.compute_ns();
  const std::int64_t sent_ns = sent_ns_[answer.sequence() % sent_ns_.size()];
  const std::int64_t received_ns = converted.received_ns;
  clock_offset_.add({sent_ns, left_ns - stayed_ns, left_ns, received_ns});
  if (!clock_offset_.known()) return;
  converted.round_trip_s = clock_offset_.round_trip_s();
  converted.clock_offset_s = stats_.clock_offset_s = clock_offset_.offset_s(received_ns);
  stats_.clock_offset_error_s = clock_offset_.error_s(received_ns);
  if (answer.model_stamp().instance() == service_instance_)
    converted.modulus_time_s =
        1e-9 * static_cast<double>(answer.model_stamp().monotonic_ns()) - converted.clock_offset_s;
  stats_.round_trips_s.add(1e-9 * static_cast<double>(received_ns - sent_ns - stayed_ns));
}

// What is not trusted is said once a second at most; what is only remarkable (status OK) once.
void TouchLink::log_warning(const v1::TouchAnswer& answer, std::int64_t received_ns) {
  constexpr std::int64_t kEveryNs = 1'000'000'000;
  if (answer.warning().empty()) return;
  if (answer.status() == v1::TOUCH_STATUS_OK) {
    if (!remarked_) spdlog::info("the service remarks: {}", answer.warning());
    remarked_ = true;
  } else if (received_ns - warned_ns_ >= kEveryNs) {
    spdlog::warn("the service warns: {}", answer.warning());
    warned_ns_ = received_ns;
  }
}

// True when a pose may be sent now; false when the stream is over (or dead).
bool TouchLink::wait_to_send(std::unique_lock<std::mutex>& lock, std::int64_t next_ns) {
  const std::int64_t heartbeat_ns = next_ns + to_ns(kHeartbeatS);
  while (true) {
    if (stopping_ || shared_.ended) return false;
    const std::int64_t now_ns = clock_.now_ns();
    const double dead_s =
        shared_.opened ? std::max({options_.dead_s, 10 * stats_.period_s, 4 * clock_offset_.round_trip_s()})
                       : options_.open_wait_s;
    const std::int64_t dead_ns = shared_.heard_ns + to_ns(dead_s);
    if (now_ns >= dead_ns) return false;
    std::int64_t wake_ns = dead_ns;
    if (shared_.opened) {
      const bool has_credit = sequence_ - shared_.answered_sequence < credit_;
      const std::int64_t send_ns = has_credit ? next_ns : heartbeat_ns;
      if (now_ns >= send_ns) return true;
      wake_ns = std::min(wake_ns, send_ns);
    }
    changed_.wait_for(lock, duration(wake_ns - now_ns));
  }
}

void TouchLink::write(Stream& stream, grpc::ClientContext& context) {
  constexpr std::int64_t kLookAgainNs = 250'000;  // for the servo's next pose
  ServoPose pose;
  bool has_pose = false;
  std::int64_t next_ns = clock_.now_ns();
  std::int64_t sent_ns = 0;
  std::unique_lock lock(mutex_);
  while (wait_to_send(lock, next_ns)) {
    const std::int64_t now_ns = clock_.now_ns();
    const bool fresh = poses_.take(pose);
    has_pose = has_pose || fresh;
    // The same pose twice tells the service nothing, unless as a heartbeat.
    if (!has_pose || (!fresh && now_ns - sent_ns < to_ns(kHeartbeatS))) {
      next_ns = now_ns + kLookAgainNs;
      continue;
    }
    // Keeps the average rate when a wake-up is late, without bursts.
    const std::int64_t period_ns = to_ns(std::max(stats_.period_s, 0.001));
    next_ns = std::max(next_ns + period_ns, now_ns + period_ns / 2);
    sent_ns = now_ns;
    const v1::TouchRequest request = to_request(pose, ++sequence_, shared_.acknowledged, instance_);
    ++stats_.poses;
    sent_ns_[sequence_ % sent_ns_.size()] = clock_.now_ns();
    lock.unlock();
    v1::RecordEntry entry;
    *entry.mutable_touch_request() = request;
    record(std::move(entry), now_ns);
    const bool written = stream.Write(request);
    lock.lock();
    if (!written) return;  // the stream has ended; the reader learns of it too, and Finish() says why
  }
  if (shared_.ended) return;
  gave_up_ = !stopping_;
  context.TryCancel();  // ends the reader
}

void TouchLink::record(v1::RecordEntry entry, std::int64_t now_ns) {
  if (options_.recorder == nullptr) return;
  entry.set_monotonic_ns(now_ns);
  {
    std::lock_guard lock(mutex_);
    entry.set_call(call_);
  }
  options_.recorder->append(std::move(entry));
}

}  // namespace teletact::client
