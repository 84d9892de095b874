#include "bench/touch_client.h"

#include <atomic>
#include <chrono>
#include <thread>

#include "bench/basics/clock.h"
#include "bench/load/sweep.h"
#include "bench/suite.h"
#include "client/link/channel.h"
#include "client/link/scenes.h"

namespace teletact::bench {
namespace {

using Clock = std::chrono::steady_clock;
using Stream = grpc::ClientReaderWriter<v1::TouchRequest, v1::TouchResponse>;

constexpr double kGraceS = 10;  // beyond the load's own duration a stream that hangs is cut

std::int64_t ns(Clock::time_point time) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(time.time_since_epoch()).count();
}

v1::TouchRequest open_request(const std::string& scene_id, unsigned client) {
  v1::TouchRequest request;
  request.mutable_open()->set_scene_id(scene_id);
  request.mutable_open()->set_credit(2);
  request.mutable_open()->set_period_s(0.001);
  request.mutable_open()->set_session_id("bench-" + std::to_string(client));
  return request;
}

v1::TouchRequest pose_request(std::uint64_t sequence, std::uint64_t acknowledged, Clock::time_point stamp,
                              double x_m, double indentation_m) {
  v1::TouchRequest request;
  v1::ContactPose& pose = *request.mutable_pose();
  pose.set_sequence(sequence);
  pose.set_acknowledged(acknowledged);
  pose.mutable_stamp()->set_monotonic_ns(ns(stamp));
  for (const double coordinate : {x_m, indentation_m, 0.0}) pose.add_position_m(coordinate);
  for (int axis = 0; axis < 3; ++axis) pose.add_velocity_m_s(0);
  return request;
}

double finger_m(const LoadOptions& options, unsigned client, double time_s) {
  return sweep_m(options.begin_m, options.end_m, options.speed_m_s, client, time_s);
}

// A stream that was accepted.
struct OpenStream {
  grpc::ClientContext context;
  std::unique_ptr<v1::Palpation::Stub> stub;
  std::unique_ptr<Stream> stream;

  OpenStream(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id, unsigned client,
             double seconds)
      : stub(v1::Palpation::NewStub(channel)) {
    context.set_deadline(std::chrono::system_clock::now() +
                         std::chrono::milliseconds(static_cast<std::int64_t>((seconds + kGraceS) * 1e3)));
    client::name_scene(context, scene_id);
    stream = stub->Touch(&context);
    v1::TouchResponse response;
    if (!stream->Write(open_request(scene_id, client)) || !stream->Read(&response) || !response.has_opened())
      fail();
  }
  [[noreturn]] void fail() {
    throw BenchError("the touch stream ended: " + client::describe(stream->Finish()));
  }
  void close() {
    stream->WritesDone();
    v1::TouchResponse rest;
    while (stream->Read(&rest)) {
    }
    stream->Finish();
  }
};

void count(const v1::TouchAnswer& answer, LoadResult& result) {
  ++result.answers;
  result.without_force +=
      answer.status() != v1::TOUCH_STATUS_OK && answer.status() != v1::TOUCH_STATUS_DEGRADED;
}

void add_latency(double latency_s, double answered_s, LoadResult& result) {
  result.latency_s.push_back(latency_s);
  result.answered_s.push_back(answered_s);
}

LoadResult closed_loop(OpenStream& open, const LoadOptions& options, unsigned client) {
  LoadResult result;
  const Clock::time_point begin = Clock::now();
  v1::TouchResponse response;
  while (true) {
    const Clock::time_point sent = Clock::now();
    result.elapsed_s = std::chrono::duration<double>(sent - begin).count();
    if (result.elapsed_s >= options.duration_s) return result;
    const double x_m = finger_m(options, client, result.elapsed_s);
    ++result.poses;
    if (!open.stream->Write(pose_request(result.poses, result.answers, sent, x_m, options.indentation_m)))
      open.fail();
    do {
      if (!open.stream->Read(&response)) open.fail();
    } while (!response.has_answer() || response.answer().sequence() != result.poses);
    count(response.answer(), result);
    add_latency(seconds_since(sent), seconds_since(begin), result);
  }
}

LoadResult open_loop(OpenStream& open, const LoadOptions& options, unsigned client) {
  LoadResult result;
  std::atomic<std::uint64_t> received{0};
  const Clock::time_point begin = Clock::now();
  std::thread reader([&] {
    v1::TouchResponse response;
    std::uint64_t answered = 0;  // poses
    while (open.stream->Read(&response)) {
      if (!response.has_answer()) continue;
      received = response.answer().answer();
      count(response.answer(), result);
      const double now_s = seconds_since(begin);
      for (; answered < response.answer().sequence(); ++answered)
        add_latency(now_s - static_cast<double>(answered) / options.rate_hz, now_s, result);
    }
  });
  std::uint64_t poses = 0;
  bool alive = true;
  while (alive) {
    const double due_s = static_cast<double>(poses) / options.rate_hz;
    if (due_s >= options.duration_s) break;
    const auto due =
        begin + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(due_s));
    std::this_thread::sleep_until(due);
    ++poses;
    alive = open.stream->Write(
        pose_request(poses, received, due, finger_m(options, client, due_s), options.indentation_m));
  }
  const double elapsed_s = std::chrono::duration<double>(Clock::now() - begin).count();
  open.stream->WritesDone();
  reader.join();
  const grpc::Status status = open.stream->Finish();
  if (!alive) throw BenchError("the touch stream ended: " + client::describe(status));
  result.poses = poses;
  result.elapsed_s = elapsed_s;
  return result;
}

}  // namespace

LoadOptions load_over(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id) {
  v1::Scene scene;
  const grpc::Status status =
      client::get_scene(*v1::Palpation::NewStub(channel), scene_id, v1::SCENE_VIEW_BASIC, scene);
  if (!status.ok()) throw BenchError("GetScene: " + client::describe(status));
  constexpr double kInsideM = 0.008;
  LoadOptions load;
  load.scene_id = scene_id;
  for (const client::Extent& extent : client::touchable_extents(scene)) {
    if (extent.end_x_m - extent.begin_x_m <= load.end_m - load.begin_m + 2 * kInsideM) continue;
    load.begin_m = extent.begin_x_m + kInsideM;
    load.end_m = extent.end_x_m - kInsideM;
  }
  if (!(load.end_m > load.begin_m))
    throw BenchError("--scene " + scene_id + ": nothing in it can be touched");
  return load;
}

LoadResult run_load(const std::shared_ptr<grpc::Channel>& channel, const LoadOptions& options,
                    unsigned client) {
  OpenStream open(channel, options.scene_id, client, options.duration_s);
  if (options.rate_hz > 0) return open_loop(open, options, client);
  LoadResult result = closed_loop(open, options, client);
  open.close();
  return result;
}

v1::TouchAnswer touch_once(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id,
                           double x_m, double indentation_m) {
  OpenStream open(channel, scene_id, 0, 0);
  if (!open.stream->Write(pose_request(1, 0, Clock::now(), x_m, indentation_m))) open.fail();
  v1::TouchResponse response;
  do {
    if (!open.stream->Read(&response)) open.fail();
  } while (!response.has_answer());
  open.close();
  if (response.answer().force_n_size() < 2)
    throw BenchError("an answer without force: " + response.answer().warning());
  return response.answer();
}

}  // namespace teletact::bench
