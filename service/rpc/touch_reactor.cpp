#include "service/rpc/touch_reactor.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <cmath>

#include "service/rpc/client.h"
#include "service/rpc/convert.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

constexpr std::chrono::minutes kLook{1};  // whoever ends the stream wakes its thread

std::chrono::steady_clock::duration period_from(double wished_s, const Limits& limits) {
  if (wished_s == 0) wished_s = TouchReactor::kDefaultPeriodS;
  if (!(wished_s > 0 && wished_s <= limits.most_touch_period_s))
    throw std::invalid_argument(fmt::format("open.period_s: {} is not within (0, {}]; leave it out for {} s",
                                            wished_s, limits.most_touch_period_s,
                                            TouchReactor::kDefaultPeriodS));
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(std::max(wished_s, 1 / limits.most_touch_rate_hz)));
}

}  // namespace

TouchReactor::TouchReactor(Core& core, grpc::CallbackServerContext* context)
    : ServedStream(core.calls, context, Allowance(2 * core.limits.most_touch_rate_hz)), core_(core) {}

TouchReactor* TouchReactor::serve(Core& core, grpc::CallbackServerContext* context) {
  return ServedCall::serve(std::make_shared<TouchReactor>(core, context), CallKind::kTouch);
}

void TouchReactor::take(const v1::TouchRequest& request) {
  if (request.has_open())
    open(request.open());
  else if (request.has_pose())
    take_pose(request.pose());
  else if (request.has_hand_over() && session_)
    board().hand_over(finger_, request.hand_over().session_id(), Clock::now());
  else
    throw std::invalid_argument("kind: empty request, or hand_over before open; send open, then pose");
}

void TouchReactor::check() const {
  core_.calls.require_open();
  if (opened_ && session_->scene()->deleted())
    throw Error(ErrorKind::kAborted, fmt::format("scene {} was deleted", session_->scene()->id()));
}

void TouchReactor::tick(Clock::time_point now) {
  ServedStream::tick(now);
  const auto silent = now - heard_.load();
  if (!opened_) {
    if (silent > seconds(core_.limits.first_message_s))
      throw Error(ErrorKind::kDeadline,
                  fmt::format("open: not sent within {} s; open a new stream", core_.limits.first_message_s));
    return;
  }
  if (silent > seconds(core_.limits.touch_idle_s))
    throw Error(ErrorKind::kDeadline,
                fmt::format("no pose for {} s; open a new stream", core_.limits.touch_idle_s));
}

void TouchReactor::open(const v1::TouchOpen& open) {
  if (session_) throw std::invalid_argument("open: sent twice; send poses, or open another stream");
  credit_ = open.credit() == 0 ? 1 : open.credit();
  if (credit_ > core_.limits.most_credit)
    throw std::invalid_argument(
        fmt::format("open.credit: {} is more than {}; ask for fewer answers in flight", credit_,
                    core_.limits.most_credit));
  period_ = period_from(open.period_s(), core_.limits);
  if (open.session_id().size() > kMostSessionIdBytes)
    throw std::invalid_argument(fmt::format("open.session_id: {} bytes; choose a name of at most {}",
                                            open.session_id().size(), kMostSessionIdBytes));
  name_ = shown(open.session_id());
  auto scene = core_.scenes.find(open.scene_id());
  TouchOptions options = touch_options_from(open);
  options.client = client_of(*context_);
  session_ = std::make_unique<TouchSession>(scene, std::move(options), core_.device);
  spdlog::info("event=touch_opened stream={} session=\"{}\" scene={} peer={} credit={} period_s={:.4f}", id(),
               name_, scene->id(), context_->peer(), credit_, std::chrono::duration<double>(period_).count());
  heard_ = Clock::now();
  finger_ = board().join(open.session_id(), heard_);
  opened_ = true;
  if (!hold()) return;
  try {
    thread_ = std::thread([this] { solve_and_write(); });
  } catch (...) {
    release();
    throw;
  }
}

void TouchReactor::take_pose(const v1::ContactPose& pose) {
  const auto arrived = Clock::now();
  if (!session_) throw std::invalid_argument("open: the first message of a touch stream must be open");
  if (pose.sequence() <= last_sequence_)
    throw std::invalid_argument(
        fmt::format("pose.sequence: {} after {}; count up from 1", pose.sequence(), last_sequence_));
  if (pose.acknowledged() > written_ || pose.acknowledged() < acknowledged_)
    throw std::invalid_argument(fmt::format(
        "pose.acknowledged: {}, but {} answers were sent and {} acknowledged; give the number of the "
        "newest answer received",
        pose.acknowledged(), written_.load(), acknowledged_.load()));
  const auto position_m = vector_from("pose.position_m", pose.position_m(), false);
  const auto velocity_m_s = vector_from("pose.velocity_m_s", pose.velocity_m_s(), true);
  // Whoever is silent may be idle; whoever sends poses has had the time to read.
  if (pose.acknowledged() > acknowledged_)
    owed_ = arrived;
  else if (acknowledged_ < written_ && arrived - owed_.load() > seconds(core_.limits.acknowledge_s))
    throw Error(ErrorKind::kDeadline,
                fmt::format("pose.acknowledged: still {} after {} s, {} answers were sent; acknowledge the "
                            "newest answer with each pose, or open a new stream",
                            acknowledged_.load(), core_.limits.acknowledge_s, written_.load()));
  last_sequence_ = pose.sequence();
  heard_ = arrived;
  board().arrive(finger_, position_m, velocity_m_s, arrived);
  ++poses_;
  poses_lost_ += inbox_.put({pose, position_m, arrived});
  // After the pose: what it makes room for is its own answer, not an older one's.
  if (acknowledged_.exchange(pose.acknowledged()) != pose.acknowledged()) inbox_.wake();
}

void TouchReactor::solve_and_write() {
  const auto stopped = [this] { return life().ended(); };
  const auto may_write = [this] { return !writing() && written_ - acknowledged_ < credit_; };
  during([this] { write_opened(); });
  auto due = Clock::now();
  while (!stopped()) {
    inbox_.wait(due, stopped);  // keep the period; poses that come meanwhile replace each other
    const auto pose = inbox_.take(Clock::now() + kLook, may_write, stopped);
    if (!pose) continue;
    // A late pose is caught up with over one period, no more.
    due = std::max(due, Clock::now() - period_) + period_;
    during([&] { write_answer(*pose); });
  }
  board().leave(finger_, Clock::now());  // here already: the end itself may wait for the peer
  release();                             // last: OnDone may follow at once
}

template <class Message>
void TouchReactor::steering_to(Message& out) {
  FingerBoard::Steering steering = board().steering(finger_, Clock::now());
  out.set_steers(steering.steers);
  out.set_steered_by(std::move(steering.by));
}

void TouchReactor::write_opened() {
  v1::TouchOpened* opened = response_.mutable_opened();
  const double finger_x_m = board().now().position_m[0];
  const Region covered = session_->scene()->snapshot()->covered_around(finger_x_m);
  opened->set_period_s(std::chrono::duration<double>(period_).count());
  opened->set_credit(credit_);
  opened->set_instance(core_.instance);
  layer_to(session_->layer(), opened->mutable_layer());
  region_to(covered, opened->mutable_covered());
  steering_to(*opened);
  write(response_);
}

void TouchReactor::write_answer(const Pose& pose) {
  const auto begun = Clock::now();
  const std::shared_ptr<Device> device = core_.device;
  session_->use(device);
  const TouchAnswer solved = session_->solve(pose.position_m);
  const auto solved_at = Clock::now();
  if (solved.device_failed) core_.device.failed(device, solved.warning);
  v1::TouchAnswer* answer = response_.mutable_answer();  // replaces `opened`
  answer->Clear();
  answer_to(solved, answer);
  answer->set_answer(written_ + 1);
  answer->set_sequence(pose.pose.sequence());
  *answer->mutable_pose_stamp() = pose.pose.stamp();
  *answer->mutable_position_m() = pose.pose.position_m();
  answer->set_compute_ns((solved_at - begun).count());
  answer->set_queued_ns((begun - pose.arrived).count());
  if (solved.taken_in != Clock::time_point()) {
    answer->mutable_model_stamp()->set_monotonic_ns(monotonic_ns(solved.taken_in));
    answer->mutable_model_stamp()->set_instance(core_.instance);
  }
  steering_to(*answer);
  answer->mutable_answer_stamp()->set_monotonic_ns(monotonic_ns());
  answer->mutable_answer_stamp()->set_instance(core_.instance);
  if (acknowledged_ == written_) owed_ = Clock::now();
  ++written_;  // before the write: its acknowledgement may be quicker than we are
  write(response_);
}

void TouchReactor::closed() {
  if (thread_.joinable()) thread_.join();
  if (!session_) return;
  board().leave(finger_, Clock::now());
  spdlog::info(
      "event=touch_closed stream={} session=\"{}\" scene={} poses={} poses_replaced={} answers={} code={}",
      id(), name_, session_->scene()->id(), poses_, poses_lost_, written_.load(),
      static_cast<int>(life().status().error_code()));
  session_.reset();
}

}  // namespace teletact::service
