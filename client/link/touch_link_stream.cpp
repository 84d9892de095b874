// One touch stream of the link: what goes out, what comes in, and when it counts as dead.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "client/link/scenes.h"
#include "client/link/servo_messages.h"
#include "client/link/touch_link.h"

namespace teletact::client {
namespace {

// From this round trip on a guessed law is nearer to the tissue than answers are: at 120 mm/s they are of 4
// mm before.
constexpr double kGuessedFromS = 0.03, kGuessedToS = 0.02;
constexpr std::size_t kMaxTried = 4096;  // messages of a successor that does not come into force

std::chrono::steady_clock::duration duration(std::int64_t ns) {
  return std::chrono::nanoseconds(ns);
}

// Whether the hand may go by it.
bool can_be_felt(const v1::TouchAnswer& answer) {
  return answer.status() != v1::TOUCH_STATUS_PREPARING && answer.status() != v1::TOUCH_STATUS_FAILED;
}

}  // namespace

grpc::Status TouchLink::serve(v1::Palpation::Stub& stub, Attempt& attempt) {
  grpc::ClientContext context;
  name_scene(context, options_.open.scene_id());
  {
    std::lock_guard lock(mutex_);
    attempt.heard_ns = clock_.now_ns();
  }
  std::thread guarding([this, &context, &attempt] { guard(context, attempt); });
  const auto stream = stub.Touch(&context);
  if (write_open(*stream, attempt)) {
    std::thread reader([this, &stream, &attempt] { read(*stream, attempt); });
    write_poses(*stream, attempt);
    reader.join();
  }
  const grpc::Status status = stream->Finish();
  {
    std::lock_guard lock(mutex_);
    attempt.over = true;
    changed_.notify_all();
  }
  guarding.join();
  std::lock_guard lock(mutex_);
  if (!attempt.problem.empty()) return {grpc::StatusCode::DATA_LOSS, attempt.problem};
  return attempt.gave_up ? grpc::Status(grpc::StatusCode::DEADLINE_EXCEEDED, "the service says nothing")
                         : status;
}

// The stream's calls wait for the peer for as long as it likes; this ends them.
void TouchLink::guard(grpc::ClientContext& context, Attempt& attempt) {
  std::unique_lock lock(mutex_);
  while (!attempt.over) {
    const double dead_s =
        attempt.opened
            ? std::max({options_.dead_s, 10 * received_.stats.period_s, 4 * received_.round_trip_s()})
            : options_.open_wait_s;
    const std::int64_t since_ns =
        attempt.writing_ns == 0 ? attempt.heard_ns : std::min(attempt.heard_ns, attempt.writing_ns);
    const std::int64_t left_ns = since_ns + to_ns(dead_s) - clock_.now_ns();
    const bool unwanted = stopping_ || attempt.left;
    if (unwanted || left_ns <= 0 || !attempt.problem.empty()) {
      attempt.gave_up = !unwanted;
      lock.unlock();
      context.TryCancel();
      return;
    }
    changed_.wait_for(lock, duration(left_ns));
  }
}

// A recording has the link's own order of what was sent and heard, of one stream after the other.
void TouchLink::record(Attempt& attempt, v1::RecordEntry entry) {
  entry.set_call(attempt.call);
  if (&attempt == in_force_)
    options_.recorder->append(std::move(entry));
  else if (!attempt.left)
    attempt.recorded.push_back(std::move(entry));
}

void TouchLink::read(Stream& stream, Attempt& attempt) {
  v1::TouchResponse response;
  std::size_t tried = 0;
  while (stream.Read(&response)) {
    const std::int64_t now_ns = clock_.now_ns();
    v1::RecordEntry entry;  // copied before the lock, which the writer of poses waits for
    if (options_.recorder != nullptr) entry = recorded(response, now_ns, 0);
    std::lock_guard lock(mutex_);
    if (options_.recorder != nullptr) record(attempt, std::move(entry));
    if (response.has_opened()) take_opened(attempt, response.opened(), now_ns);
    if (response.has_answer()) take_answer(attempt, response.answer(), now_ns);
    if (response.has_law()) take_law(attempt, response.law());
    if (&attempt != in_force_ && ++tried > kMaxTried)
      attempt.problem = "it answers nothing that can be felt";
    changed_.notify_all();
  }
  std::lock_guard lock(mutex_);
  attempt.ended = true;
  changed_.notify_all();
}

void TouchLink::take_opened(Attempt& attempt, const v1::TouchOpened& opened, std::int64_t received_ns) {
  if (attempt.opened) return;  // once per stream
  attempt.opened = true;
  attempt.heard_ns = attempt.opened_ns = received_ns;
  attempt.opening = opened;
  attempt.law.open(opened.layer().depth_m());
  if (&attempt == in_force_) {
    come_into_force(attempt);
  } else if (lets_first_ &&
             opened.steers()) {  // it took a while to serve, and who steers here is not there yet
    lets_first_ = false;
    may_move_ns_ = received_ns + to_ns(options_.yield_s);
    attempt.problem = "whoever steers here goes first";
  } else {
    attempt.law.go_on_from(in_force_->law);
  }
}

// From now on it is what is felt: as a stream that was opened just now, whenever that was. False where what
// it was opened with cannot be worked with.
bool TouchLink::come_into_force(Attempt& attempt) {
  const std::string problem = attempt.opened ? received_.take_opened(attempt.opening, attempt.opened_ns) : "";
  if (!problem.empty()) {
    attempt.problem = problem;
    attempt.opened = false;
    changed_.notify_all();
    return false;
  }
  if (&attempt != in_force_) {
    attempt.call = ++call_;
    in_force_->left = true;
    moving_ = false;
    in_force_ = &attempt;
    changed_.notify_all();
    turn_.notify_all();
  }
  for (v1::RecordEntry& entry : std::exchange(attempt.recorded, {})) {
    entry.set_call(attempt.call);
    options_.recorder->append(std::move(entry));
  }
  tell_law();
  return true;
}

void TouchLink::take_answer(Attempt& attempt, const v1::TouchAnswer& answer, std::int64_t received_ns) {
  // There is no layer and no period yet, or another one is felt, or this one is being ended.
  if (!attempt.opened || attempt.left || !attempt.problem.empty()) return;
  attempt.heard_ns = received_ns;
  attempt.acknowledged = answer.answer();
  const bool ours = answer.pose_stamp().instance() == instance_ && answer.sequence() <= sequence_;
  if (&attempt != in_force_) {
    if (ours) attempt.answered_sequence = std::max(attempt.answered_sequence, answer.sequence());
    if (!ours || !can_be_felt(answer) || !come_into_force(attempt)) return;
    spdlog::info("the service stops; its successor answers from now on");
  }
  const bool recent = ours && sequence_ - answer.sequence() < sent_ns_.size();
  const std::int64_t sent_ns = recent ? sent_ns_[answer.sequence() % sent_ns_.size()] : 0;
  if (const auto converted = received_.take_answer(answer, ours, sent_ns, received_ns)) {
    attempt.answered_sequence = std::max(attempt.answered_sequence, answer.sequence());
    answers_.put(*converted);
    if (answer.has_tactile()) keep_tactile(answer.tactile());
  }
  if (std::exchange(moving_, answer.moving()) == answer.moving()) return;
  const bool yields = !answer.steers() && !answer.steered_by().empty();
  may_move_ns_ = received_ns + (yields ? to_ns(options_.yield_s) : 0);
  lets_first_ = yields;
  turn_.notify_all();
}

void TouchLink::keep_tactile(const v1::TactileImage& image) {
  auto read = tactile_from(image);
  if (read) {
    ++received_.stats.tactile_images;
    tactile_ = std::move(read);
  } else if (++received_.stats.tactile_dropped == 1) {
    spdlog::warn("a tactile image was malformed and is not shown");
  }
}

void TouchLink::take_law(Attempt& attempt, const v1::LawPiece& piece) {
  if (!attempt.opened || options_.laws == nullptr) return;
  attempt.heard_ns = clock_.now_ns();
  if (attempt.law.take(piece, finger_m_.x(), finger_m_.z()))
    ++received_.stats.law_pieces;
  else if (++received_.stats.laws_dropped == 1)
    spdlog::warn("a piece of a contact law was malformed: forces come from answers alone");
  if (&attempt == in_force_) tell_law();
}

// Whose answers are quick feels those sooner than a guess.
void TouchLink::tell_law() {
  if (options_.laws == nullptr) return;
  guesses_ = received_.round_trip_s() > (guesses_ ? kGuessedToS : kGuessedFromS);
  if (const auto law = in_force_->law.fresh(finger_m_.x(), finger_m_.z(), guesses_)) options_.laws->put(*law);
}

bool TouchLink::has_room(const Attempt& attempt) const {
  const std::uint64_t most = &attempt == in_force_ ? received_.pacing.in_flight() : 1;
  return attempt.sent_sequence - attempt.answered_sequence < most;
}

double TouchLink::interval_s(const Attempt& attempt) const {
  if (&attempt != in_force_) return kTrialPeriodS;
  return PosePace::interval_s(received_.pacing.interval_s(), pose_.by_law, options_.open.has_tactile());
}

// True when a pose may be sent now; false when the stream is over.
bool TouchLink::wait_to_send(std::unique_lock<std::mutex>& lock, const Attempt& attempt,
                             const PosePace& pace) {
  while (true) {
    if (stopping_ || attempt.ended || attempt.left) return false;
    const std::int64_t now_ns = clock_.now_ns();
    const std::int64_t due_ns = pace.due_ns(has_room(attempt), received_.round_trip_s());
    if (!attempt.opened) {
      changed_.wait(lock);
    } else if (now_ns < due_ns) {
      changed_.wait_for(lock, duration(due_ns - now_ns));
    } else {
      return true;
    }
  }
}

bool TouchLink::write_open(Stream& stream, Attempt& attempt) {
  v1::TouchRequest request;
  std::unique_lock lock(mutex_);
  *request.mutable_open() = options_.open;
  return write(stream, request, clock_.now_ns(), attempt, lock);
}

void TouchLink::write_poses(Stream& stream, Attempt& attempt) {
  PosePace pace(clock_.now_ns());
  std::unique_lock lock(mutex_);
  while (wait_to_send(lock, attempt, pace)) {
    if (!hand_over_to_.empty() && &attempt == in_force_) {
      v1::TouchRequest request;
      request.mutable_hand_over()->set_session_id(std::exchange(hand_over_to_, ""));
      if (!write(stream, request, clock_.now_ns(), attempt, lock)) return;
    }
    const std::int64_t now_ns = clock_.now_ns();
    if (poses_.take(pose_)) ++poses_given_;
    if (poses_given_ == 0 || !pace.worth_sending(attempt.poses_seen != poses_given_, now_ns)) {
      pace.look_again(now_ns);
      continue;
    }
    attempt.poses_seen = poses_given_;
    finger_m_ = pose_.pose.position_m;
    tell_law();
    pace.sent(interval_s(attempt), now_ns);
    ++received_.stats.poses;
    // Poses between, of another stream, are none that this one waits for.
    if (attempt.sent_sequence == attempt.answered_sequence) attempt.answered_sequence = sequence_;
    sent_ns_[++sequence_ % sent_ns_.size()] = now_ns;
    attempt.sent_sequence = sequence_;
    received_.pacing.sent(sequence_);
    v1::TouchRequest request = to_request(pose_, sequence_, attempt.acknowledged, instance_);
    request.mutable_pose()->set_laws_acknowledged(attempt.law.pieces());
    if (!write(stream, request, now_ns, attempt, lock)) return;
  }
}

// Called with the lock, which the transport is not waited for with. False: the stream has ended; the reader
// learns of it too, and Finish() says why.
bool TouchLink::write(Stream& stream, const v1::TouchRequest& request, std::int64_t now_ns, Attempt& attempt,
                      std::unique_lock<std::mutex>& lock) {
  if (options_.recorder != nullptr) record(attempt, recorded(request, now_ns, 0));
  attempt.writing_ns = now_ns;
  lock.unlock();
  const bool written = stream.Write(request);
  lock.lock();
  attempt.writing_ns = 0;
  return written;
}

}  // namespace teletact::client
