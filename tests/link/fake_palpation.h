// A Palpation service over analytic tissue, in this process, that can be slow, silent or killed, and that
// keeps account of what the client sends.
#pragma once

#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/render/analytic_tissue.h"

namespace teletact::client::test {

struct FakeAccount {
  std::uint64_t streams = 0;
  std::uint64_t refused = 0;  // streams, for now
  std::uint64_t poses = 0;
  std::uint64_t answers = 0;
  std::uint64_t max_unacknowledged = 0;  // answers, as the client's poses acknowledge them
  std::uint64_t max_unanswered = 0;      // poses in flight, when one came that was no heartbeat
  std::uint64_t disorder = 0;             // poses whose sequence did not increase, over all streams
  std::uint64_t wrong_acknowledgements = 0;
  double last_x_m = 0;  // of a pose
  std::string session;
  bool session_kept = true;
  std::string handed_over_to;
};

inline auto answers_at_least(std::uint64_t count) {
  return [count](const FakeAccount& account) { return account.answers >= count; };
}

class FakePalpation final : public v1::Palpation::Service {
 public:
  explicit FakePalpation(std::string address) : address_(std::move(address)) {}
  ~FakePalpation() override { kill(); }

  void serve() {
    grpc::ServerBuilder builder;
    builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
    builder.AddListeningPort(address_, grpc::InsecureServerCredentials());
    builder.RegisterService(this);
    stopping_ = false;
    ++instance_;
    server_ = builder.BuildAndStart();
  }
  // As kill -9 looks to the client: streams are cut.
  void kill() {
    if (!server_) return;
    {
      std::lock_guard lock(mutex_);
      stopping_ = true;
      changed_.notify_all();
    }
    server_->Shutdown(std::chrono::system_clock::now());
    server_->Wait();
    server_.reset();
  }

  v1::ContactPose last_pose() {
    std::lock_guard lock(mutex_);
    return last_pose_;
  }
  FakeAccount account() {
    std::lock_guard lock(mutex_);
    return account_;
  }
  // Waits until `met` holds for the account; false after `seconds`.
  bool wait_until(const std::function<bool(const FakeAccount&)>& met, double seconds = 10) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return met(account_); });
  }

  // Answers, or no longer does, what it was sent last.
  void speak(bool speaks) {
    std::lock_guard lock(mutex_);
    silent = !speaks;
    changed_.notify_all();
  }
  void harden(double factor) {
    std::lock_guard lock(mutex_);
    tissue.stiffness *= factor;
  }

  std::atomic<bool> silent{false};  // reads, never answers
  std::atomic<bool> scene_known{true};
  std::atomic<bool> doubts{false};    // answers DEGRADED
  std::atomic<bool> moving{false};    // says so
  std::atomic<bool> full{false};      // refuses streams for now
  std::atomic<bool> prepares{false};  // answers PREPARING
  std::atomic<bool> deaf{false};      // opens no stream, and reads nothing of it
  std::atomic<bool> refuses{false};   // ends a stream for its first pose
  std::atomic<bool> waits_for_acknowledgement{true};
  std::atomic<double> opened_period_s{0};   // of TouchOpened; 0: as asked for
  std::atomic<bool> steers{false};          // what every stream is told
  std::atomic<bool> another_steers{false};  // the same
  std::atomic<bool> confuses{false};        // answers another session's poses
  std::atomic<double> compute_s{0};         // per answer
  std::atomic<double> way_s{0};             // of each answer, to the client
  std::atomic<float> tactile_pa{0};         // of one taxel, with each answer: 0: none, < 0: malformed
  std::atomic<unsigned> credit{2};
  std::atomic<unsigned> refuses_credit_above{256};
  static constexpr std::chrono::seconds kModulusAge{7};
  std::atomic<std::chrono::steady_clock::duration> clock_ahead{};  // of the client's
  std::atomic<double> layer_depth_m{0};                            // of TouchOpened
  std::vector<std::pair<double, double>> windows_m = {{0, 0.12}};
  std::pair<double, double> z_m{0, 0};             // of a solid
  std::optional<v1::ContactPose> answers_unasked;  // a pose that another service was given
  AnalyticTissue tissue;

  grpc::Status GetScene(grpc::ServerContext*, const v1::GetSceneRequest* request, v1::Scene* scene) override {
    if (!scene_known) return {grpc::StatusCode::NOT_FOUND, "scene '" + request->scene_id() + "' is unknown"};
    scene->set_scene_id(request->scene_id());
    for (const auto& [begin_x_m, end_x_m] : windows_m) {
      v1::Window& window = *scene->add_windows();
      window.mutable_covers()->set_begin_x_m(begin_x_m);
      window.mutable_covers()->set_end_x_m(end_x_m);
      if (z_m.second > z_m.first) {
        window.mutable_covers()->set_begin_z_m(z_m.first);
        window.mutable_covers()->set_end_z_m(z_m.second);
      }
      window.set_touchable(true);
    }
    scene->mutable_geometry()->add_size_m(0.12);
    scene->mutable_geometry()->add_size_m(0.04);
    return grpc::Status::OK;
  }

  grpc::Status Touch(grpc::ServerContext* context,
                     grpc::ServerReaderWriter<v1::TouchResponse, v1::TouchRequest>* stream) override {
    while (deaf && !context->IsCancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    if (context->IsCancelled()) return grpc::Status::CANCELLED;
    v1::TouchRequest request;
    if (!stream->Read(&request) || !request.has_open()) return {grpc::StatusCode::INVALID_ARGUMENT, "open"};
    if (!scene_known) return {grpc::StatusCode::NOT_FOUND, "scene is unknown"};
    if (full) return refuse();
    if (request.open().credit() > refuses_credit_above)
      return {grpc::StatusCode::INVALID_ARGUMENT, "open.credit: ask for fewer answers in flight"};
    begin_stream(request.open());
    v1::TouchResponse opened;
    opened.mutable_opened()->set_period_s(opened_period_s == 0 ? std::max(request.open().period_s(), 0.001)
                                                               : opened_period_s.load());
    opened.mutable_opened()->set_steers(steers);
    opened.mutable_opened()->set_credit(credit);
    opened.mutable_opened()->set_instance(instance_);
    if (layer_depth_m != 0) opened.mutable_opened()->mutable_layer()->set_depth_m(layer_depth_m);
    stream->Write(opened);
    if (answers_unasked) {
      v1::TouchResponse answer;
      answer.mutable_answer()->set_answer(1);
      fill(*answers_unasked, *answer.mutable_answer());
      stream->Write(answer);
    }
    if (refuses) {
      stream->Read(&request);
      return {grpc::StatusCode::INVALID_ARGUMENT, "position_m: beside the tissue"};
    }
    Mailbox mailbox;
    std::thread reader([&] {
      v1::TouchRequest next;
      while (stream->Read(&next))
        next.has_hand_over() ? receive(next.hand_over()) : receive(next.pose(), mailbox);
      std::lock_guard lock(mutex_);
      mailbox.closed = true;
      changed_.notify_all();
    });
    while (answer_next(*stream, mailbox)) {
    }
    // Unblocks the reader whatever ended the loop.
    context->TryCancel();
    reader.join();
    return {grpc::StatusCode::UNAVAILABLE, "the service is shutting down"};
  }

 private:
  struct Mailbox {
    v1::ContactPose pose;
    std::chrono::steady_clock::time_point arrived;
    bool fresh = false;
    bool closed = false;
    std::uint64_t answers = 0, acknowledged = 0, answered_sequence = 0, first_sequence = 0;
  };

  grpc::Status refuse() {
    std::lock_guard lock(mutex_);
    ++account_.refused;
    changed_.notify_all();
    return {grpc::StatusCode::UNAVAILABLE, "no place"};
  }

  void begin_stream(const v1::TouchOpen& open) {
    std::lock_guard lock(mutex_);
    ++account_.streams;
    if (!account_.session.empty() && account_.session != open.session_id()) account_.session_kept = false;
    account_.session = open.session_id();
    changed_.notify_all();
  }

  void receive(const v1::HandOver& hand_over) {
    std::lock_guard lock(mutex_);
    account_.handed_over_to = hand_over.session_id();
    changed_.notify_all();
  }

  void receive(const v1::ContactPose& pose, Mailbox& mailbox) {
    std::lock_guard lock(mutex_);
    ++account_.poses;
    account_.last_x_m = pose.position_m_size() > 0 ? pose.position_m(0) : NAN;
    if (pose.sequence() <= last_sequence_) ++account_.disorder;
    last_sequence_ = pose.sequence();
    if (mailbox.first_sequence == 0)
      mailbox.answered_sequence = (mailbox.first_sequence = pose.sequence()) - 1;
    if (pose.acknowledged() > mailbox.answers || pose.acknowledged() < mailbox.acknowledged) {
      ++account_.wrong_acknowledgements;
    }
    mailbox.acknowledged = pose.acknowledged();
    // A heartbeat, of a busy machine too, goes out whatever is unanswered.
    constexpr std::int64_t kHeartbeatNs = 50'000'000;
    if (pose.stamp().monotonic_ns() - mailbox.pose.stamp().monotonic_ns() < kHeartbeatNs)
      account_.max_unanswered =
          std::max(account_.max_unanswered, pose.sequence() - mailbox.answered_sequence);
    mailbox.pose = last_pose_ = pose;
    mailbox.arrived = std::chrono::steady_clock::now();
    mailbox.fresh = true;
    changed_.notify_all();
  }

  bool answer_next(grpc::ServerReaderWriter<v1::TouchResponse, v1::TouchRequest>& stream, Mailbox& mailbox) {
    v1::TouchResponse response;
    v1::TouchAnswer& answer = *response.mutable_answer();
    std::chrono::steady_clock::time_point arrived;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] {
        const bool acknowledged =
            !waits_for_acknowledgement || mailbox.answers - mailbox.acknowledged < credit;
        const bool may = mailbox.fresh && !silent && acknowledged;
        return stopping_ || mailbox.closed || may;
      });
      if (stopping_ || mailbox.closed) return false;
      mailbox.fresh = false;
      fill(mailbox.pose, answer);
      if (confuses) answer.mutable_pose_stamp()->set_instance(mailbox.pose.stamp().instance() + 1);
      arrived = mailbox.arrived;
      answer.set_answer(mailbox.answers + 1);
    }
    const auto begun = std::chrono::steady_clock::now();
    if (compute_s > 0) std::this_thread::sleep_for(std::chrono::duration<double>(compute_s.load()));
    const auto left = std::chrono::steady_clock::now();
    answer.set_queued_ns((begun - arrived).count());
    answer.set_compute_ns((left - begun).count());
    answer.mutable_answer_stamp()->set_monotonic_ns((left.time_since_epoch() + clock_ahead.load()).count());
    answer.mutable_model_stamp()->set_instance(instance_);
    answer.mutable_model_stamp()->set_monotonic_ns(
        (left.time_since_epoch() + clock_ahead.load() - kModulusAge).count());
    if (way_s > 0) std::this_thread::sleep_for(std::chrono::duration<double>(way_s.load()));
    {
      std::lock_guard lock(mutex_);
      ++mailbox.answers;
      ++account_.answers;
      account_.max_unacknowledged =
          std::max(account_.max_unacknowledged, mailbox.answers - mailbox.acknowledged);
      mailbox.answered_sequence = answer.sequence();
      changed_.notify_all();
    }
    return stream.Write(response);
  }

  template <class Message>
  static void add_force(const ForceSample& sample, Message& out) {
    for (const double force : sample.force_n) out.add_force_n(force);
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column) out.add_tangent_n_m(sample.tangent_n_m(row, column));
  }

  void add_tactile(v1::TouchAnswer& answer) const {
    const float pressure_pa = tactile_pa;
    if (pressure_pa == 0) return;
    v1::TactileImage& image = *answer.mutable_tactile();
    image.set_sequence(answer.sequence());
    for (const double at_m : answer.position_m()) image.add_centre_m(at_m);
    image.set_pitch_m(pressure_pa < 0 ? 0 : 0.002);
    image.mutable_pressure_pa()->set_dtype(v1::DATA_TYPE_FLOAT32);
    for (int k = 0; k < 2; ++k) image.mutable_pressure_pa()->add_shape(1);
    image.mutable_pressure_pa()->set_data(&pressure_pa, sizeof(pressure_pa));
  }

  void fill(const v1::ContactPose& pose, v1::TouchAnswer& answer) const {
    const Vector3 at_m(pose.position_m(0), pose.position_m(1), pose.position_m(2));
    answer.set_sequence(pose.sequence());
    *answer.mutable_pose_stamp() = pose.stamp();
    *answer.mutable_position_m() = pose.position_m();
    answer.set_status(prepares ? v1::TOUCH_STATUS_PREPARING
                      : doubts ? v1::TOUCH_STATUS_DEGRADED
                               : v1::TOUCH_STATUS_OK);
    answer.set_steers(steers);
    if (another_steers) answer.set_steered_by("another");
    answer.set_moving(moving);
    add_force(tissue.answer(at_m), answer);
    const ForceSample told = tissue.told(at_m);
    if (told.foreseen) {
      for (const double m : told.position_m) answer.mutable_foreseen()->add_position_m(m);
      add_force(told, *answer.mutable_foreseen());
    }
    answer.mutable_covered()->set_end_x_m(0.12);
    answer.mutable_answer_stamp()->set_instance(instance_);
    answer.set_model_version(1);
    add_tactile(answer);
  }

  std::string address_;
  std::unique_ptr<grpc::Server> server_;
  std::mutex mutex_;
  std::condition_variable changed_;
  FakeAccount account_;
  v1::ContactPose last_pose_;
  bool stopping_ = false;
  std::uint64_t last_sequence_ = 0;
  std::atomic<std::uint64_t> instance_{100};
};

// A socket of its own per test.
inline std::string socket_address(const char* test) {
  return "unix:/tmp/teletact-" + std::to_string(::getpid()) + "-" + test;
}

}  // namespace teletact::client::test
