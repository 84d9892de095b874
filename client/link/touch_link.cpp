#include "client/link/touch_link.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <random>
#include <utility>

#include "client/link/channel.h"

namespace teletact::client {
namespace {

constexpr double kConnectWaitS = 0.05;  // per look at the attempts, and whether to stop
constexpr double kLookS = 5;            // at what there is to do, where nothing is said
constexpr unsigned kOlderCredit = 8;    // at most, of services that refuse a wish instead of keeping less

std::uint64_t random_number() {
  std::random_device random;
  return (std::uint64_t{random()} << 32) | random();
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
    turn_.notify_all();
  }
  if (thread_.joinable()) thread_.join();
}

TouchLinkStats TouchLink::stats() const {
  std::lock_guard lock(mutex_);
  return received_.stats;
}

std::string TouchLink::trouble() const {
  std::lock_guard lock(mutex_);
  const bool open = in_force_ != nullptr && in_force_->opened && !in_force_->ended;
  return open ? "" : last_reason_;
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

std::unique_ptr<TouchLink::Attempt> TouchLink::begin(bool in_force) {
  auto attempt = std::make_unique<Attempt>();
  attempt->heard_ns = clock_.now_ns();
  if (in_force) {
    attempt->call = ++call_;
    in_force_ = attempt.get();
    moving_ = false;
  }
  attempt->thread = std::thread([this, &made = *attempt] { open(made); });
  return attempt;
}

// Returns once it has ended.
void TouchLink::leave(std::unique_ptr<Attempt> attempt, std::unique_lock<std::mutex>& lock) {
  if (!attempt) return;
  attempt->left = true;
  changed_.notify_all();
  lock.unlock();
  attempt->thread.join();
  lock.lock();
}

void TouchLink::open(Attempt& attempt) {
  // A new channel each time: an old one may hold on to a half-open connection or a long backoff.
  Connecting connecting(options_.address, options_.credentials);
  std::shared_ptr<grpc::Channel> channel;
  const auto unwanted = [&] {
    std::lock_guard lock(mutex_);
    return stopping_ || attempt.left;
  };
  while (!unwanted() && !channel) channel = connecting.wait(kConnectWaitS);
  grpc::Status status = grpc::Status::CANCELLED;
  if (!unwanted()) status = serve(*v1::Palpation::NewStub(channel), attempt);
  std::lock_guard lock(mutex_);
  attempt.status = std::move(status);
  turn_.notify_all();
}

void TouchLink::run() {
  std::unique_lock lock(mutex_);
  std::optional<std::int64_t> again_ns;    // when the next stream may be begun, once this one has ended
  std::int64_t move_ns = clock_.now_ns();  // the same of the next successor
  std::string said;                        // of a successor that did not come
  std::unique_ptr<Attempt> served = begin(true), successor;
  while (!stopping_) {
    const std::int64_t now_ns = clock_.now_ns();
    std::int64_t next_ns = now_ns + to_ns(kLookS);
    if (successor && in_force_ == successor.get()) {
      move_ns = now_ns + to_ns(reopening_.after_move_s(seconds_between(served->opened_ns, now_ns)));
      leave(std::exchange(served, std::move(successor)), lock);
      again_ns.reset();
      continue;
    }
    if (successor && successor->status) {
      if (const std::string why = describe(*successor->status); why != std::exchange(said, why))
        spdlog::info("the service stops, and no other has the scene yet ({})", why);
      move_ns = now_ns + to_ns(Reopening::kRetryS);
      leave(std::move(successor), lock);
      continue;
    }
    if (served->status) {
      if (successor && successor->problem.empty() && come_into_force(*successor)) continue;
      if (!again_ns) {
        const std::optional<double> wait_s = retry_after_s(*served->status, *served);
        if (!wait_s) break;
        again_ns = now_ns + to_ns(*wait_s);
      }
      if (now_ns >= *again_ns) {
        leave(std::exchange(served, begin(true)), lock);
        again_ns.reset();
        continue;
      }
      next_ns = *again_ns;
    } else if (moving_ && !successor) {
      move_ns = std::max(move_ns, may_move_ns_);
      if (now_ns >= move_ns) successor = begin(false);
      if (!successor) next_ns = move_ns;
    }
    turn_.wait_for(lock, std::chrono::nanoseconds(next_ns - now_ns));
  }
  if (successor && in_force_ == successor.get()) std::swap(served, successor);
  leave(std::move(successor), lock);
  leave(std::move(served), lock);
  in_force_ = nullptr;
}

// None: never.
std::optional<double> TouchLink::retry_after_s(const grpc::Status& status, const Attempt& attempt) {
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
    spdlog::warn("{}: {}",
                 refused ? "the touch was refused, trying again less and less often"
                         : "the link was lost, opening it again",
                 reason);
  last_reason_ = reason;
  const double lived_s = attempt.opened ? seconds_between(attempt.opened_ns, clock_.now_ns()) : 0;
  return reopening_.after_end_s(refused, lived_s);
}

}  // namespace teletact::client
