#include "client/session/replay.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <stdexcept>
#include <thread>
#include <vector>

#include "client/clock/clock.h"
#include "client/files/different_files.h"
#include "client/link/channel.h"
#include "client/link/scenes.h"
#include "teletact/v1/elastography.grpc.pb.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {
namespace {

using SteadyClock = std::chrono::steady_clock;

// The requests and responses of one stream or call.
struct Call {
  std::vector<v1::RecordEntry> requests;
  std::vector<v1::RecordEntry> responses;
};

[[noreturn]] void fail(const char* what, const grpc::Status& status) {
  throw std::runtime_error(std::string(what) + " failed: " + describe(status));
}

// Reads the calls one after the other: a recording of RF does not fit into memory as a whole. Entries of
// different calls do not interleave but for the last responses of the one before.
class CallReader {
 public:
  CallReader(const std::string& path) : reader_(path) {}
  RecordReader& reader() { return reader_; }

  std::optional<Call> next() {
    while (!ended_ && calls_.size() < 2) {
      auto entry = reader_.next();
      if (!entry) {
        ended_ = true;
      } else if (entry->has_touch_request() || entry->has_estimate_request()) {
        calls_[entry->call()].requests.push_back(std::move(*entry));
      } else if (entry->has_touch_response() || entry->has_estimate_response()) {
        calls_[entry->call()].responses.push_back(std::move(*entry));
      } else if (entry->has_scene()) {
        scene_ = entry->scene();
      }
    }
    if (calls_.empty()) return std::nullopt;
    Call call = std::move(calls_.begin()->second);
    calls_.erase(calls_.begin());
    return call;
  }
  // As it stood at the end of the recording; nothing before all calls are read, or where it was cut short.
  const std::optional<v1::Scene>& scene() const { return scene_; }

 private:
  RecordReader reader_;
  std::optional<v1::Scene> scene_;
  std::map<std::uint32_t, Call> calls_;
  bool ended_ = false;
};

// Waits until the moment that `recorded_ns` was at in the recording.
class Pace {
 public:
  explicit Pace(double speed) : speed_(speed) {}
  void wait(std::int64_t recorded_ns) {
    if (!started_) {
      begin_ = SteadyClock::now();
      begin_ns_ = recorded_ns;
      started_ = true;
    }
    if (speed_ <= 0) return;
    constexpr double kLongestS = 1e6;  // stamps of a damaged recording may lie centuries apart
    const double elapsed_s = std::clamp(seconds_between(begin_ns_, recorded_ns) / speed_, 0.0, kLongestS);
    std::this_thread::sleep_until(begin_ + std::chrono::nanoseconds(std::llround(1e9 * elapsed_s)));
  }

 private:
  double speed_;
  bool started_ = false;
  SteadyClock::time_point begin_;
  std::int64_t begin_ns_ = 0;
};

class Player {
 public:
  Player(const ReplayOptions& options, const std::atomic<bool>& stop);
  ReplayReport play();

 private:
  void play_touch(const Call& call);
  void compare(const v1::TouchAnswer& answer, const v1::TouchAnswer& recorded);
  void play_estimate(const Call& call);
  void compare(const v1::Map& map, const v1::Map& recorded, const std::string& name);
  void compare_scene(const v1::Scene& recorded);
  template <class Message>
  void keep(const Message& message) {
    if (recorder_)
      recorder_->append_waiting(recorded(message, monotonic_ns(), static_cast<std::uint32_t>(report_.calls)));
  }
  void need_scene();
  void make_scene(v1::Palpation::Stub& stub);
  [[noreturn]] void fail_nothing_to_play() const;
  const std::string& played_into(const std::string& recorded_scene) const {
    return options_.scene_id.empty() ? recorded_scene : options_.scene_id;
  }

  const ReplayOptions& options_;
  const std::atomic<bool>& stop_;
  CallReader calls_;
  Pace pace_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<RecordWriter> recorder_;
  std::string scene_id_;
  ReplayReport report_;
};

Player::Player(const ReplayOptions& options, const std::atomic<bool>& stop)
    : options_(options), stop_(stop), calls_(options.path), pace_(options.speed) {
  report_.kind = calls_.reader().header().kind();
  channel_ = make_channel(options.address, options.credentials);
  constexpr double kConnectS = 2;
  if (!wait_connected(*channel_, kConnectS)) {
    throw std::runtime_error(nobody_answers(options.address, options.credentials));
  }
  scene_id_ = options.scene_id.empty() ? calls_.reader().header().scene_id() : options.scene_id;
  need_scene();
  if (!options.record_path.empty()) {
    v1::RecordHeader header = calls_.reader().header();
    header.set_service(options.address);
    if (!options.scene_id.empty()) header.set_scene_id(options.scene_id);
    recorder_ = std::make_unique<RecordWriter>(options.record_path, header);
  }
}

// A touch needs a scene with its windows. Frames need at least an empty one: it is made as it was recorded.
void Player::need_scene() {
  const auto stub = v1::Palpation::NewStub(channel_);
  v1::Scene scene;
  const grpc::Status status = get_scene(*stub, scene_id_, v1::SCENE_VIEW_BASIC, scene);
  const bool acquire = report_.kind == "acquire";
  const bool unknown = status.error_code() == grpc::StatusCode::NOT_FOUND;
  if (!status.ok() && !unknown)
    throw std::runtime_error("cannot replay into scene '" + scene_id_ + "': " + describe(status));
  if (acquire && unknown) make_scene(*stub);
  if (acquire) return;
  if (touchable_extent(scene)) return;
  throw std::runtime_error(
      (unknown ? "no scene '" + scene_id_ + "' here"
               : "scene '" + scene_id_ + "' has nothing to touch here") +
      "; publish it first by replaying the acquisition's recording (acquire --record FILE --record-rf), or "
      "name another with --scene");
}

void Player::make_scene(v1::Palpation::Stub& stub) {
  RecordReader reader(options_.path);
  bool frames = false;
  while (const auto entry = reader.next()) {
    frames = frames || entry->estimate_request().has_chunk();
    if (!entry->has_scene()) continue;
    if (!frames) fail_nothing_to_play();  // and nothing is left behind
    v1::CreateSceneRequest create;
    create.set_scene_id(scene_id_);
    *create.mutable_geometry() = entry->scene().geometry();
    grpc::ClientContext context;
    name_scene(context, scene_id_);
    v1::Scene scene;
    const grpc::Status created = stub.CreateScene(&context, create, &scene);
    if (!created.ok()) fail("creating the scene", created);
    return;
  }
  throw std::runtime_error("scene '" + scene_id_ +
                           "' is unknown, and the recording holds none to make it from; " +
                           "name one with --scene");
}

void Player::fail_nothing_to_play() const {
  throw std::runtime_error(
      "'" + options_.path + "' holds nothing to play; record with " +
      (report_.kind == "acquire" ? "acquire --record FILE --record-rf" : "touch --record FILE"));
}

ReplayReport Player::play() {
  while (!stop_) {
    const auto call = calls_.next();
    if (!call) break;
    if (call->requests.size() < (report_.kind == "acquire" ? 2 : 1)) continue;  // its frames were not kept
    ++report_.calls;
    if (report_.kind == "acquire") {
      play_estimate(*call);
    } else {
      play_touch(*call);
    }
  }
  if (report_.calls == 0 && !stop_) fail_nothing_to_play();
  report_.truncated = calls_.reader().truncated();
  if (!stop_ && report_.kind == "acquire" && calls_.scene()) compare_scene(*calls_.scene());
  if (recorder_) recorder_->close();
  return report_;
}

// In step: a pose, its answer, the next pose. At recorded speed nothing is lost by it, and faster than that
// no pose is overtaken, so every recorded answer finds its partner.
void Player::play_touch(const Call& call) {
  std::map<std::uint64_t, const v1::TouchAnswer*> recorded;
  for (const v1::RecordEntry& entry : call.responses) {
    const v1::TouchResponse& response = entry.touch_response();
    if (response.has_answer()) recorded[response.answer().sequence()] = &response.answer();
  }
  const auto stub = v1::Palpation::NewStub(channel_);
  grpc::ClientContext context;
  name_scene(context, played_into(call.requests.front().touch_request().open().scene_id()));
  const auto stream = stub->Touch(&context);
  std::uint64_t acknowledged = 0;
  v1::TouchResponse response;
  bool open = true;
  for (const v1::RecordEntry& entry : call.requests) {
    if (stop_) break;
    v1::TouchRequest request = entry.touch_request();
    if (request.has_open()) {
      request.mutable_open()->set_scene_id(played_into(request.open().scene_id()));
      request.mutable_open()->set_laws(false);  // an answer for each pose, nothing between
    }
    if (request.has_hand_over()) continue;  // nobody else is there, and no answer follows it
    if (request.has_pose()) {
      request.mutable_pose()->set_acknowledged(acknowledged);
      request.mutable_pose()->clear_laws_acknowledged();
    }
    pace_.wait(entry.monotonic_ns());
    keep(request);
    open = stream->Write(request) && stream->Read(&response);
    if (!open) break;
    keep(response);
    if (!response.has_answer()) continue;
    ++report_.requests;
    acknowledged = response.answer().answer();
    const auto partner = recorded.find(response.answer().sequence());
    if (partner != recorded.end()) compare(response.answer(), *partner->second);
  }
  if (open) context.TryCancel();
  const grpc::Status status = stream->Finish();
  if (!open) fail("the touch stream", status);
}

void Player::compare(const v1::TouchAnswer& answer, const v1::TouchAnswer& recorded) {
  ++report_.compared;
  const int axes = std::min(answer.force_n_size(), recorded.force_n_size());
  double squared = 0, force = 0;
  for (int axis = 0; axis < axes; ++axis) {
    squared += std::pow(answer.force_n(axis) - recorded.force_n(axis), 2);
    force += std::pow(recorded.force_n(axis), 2);
  }
  if (answer.status() != recorded.status() || answer.force_n_size() != recorded.force_n_size() ||
      !std::isfinite(squared)) {
    ++report_.not_alike;
    return;
  }
  report_.forces += axes > 0;
  if (std::sqrt(squared) > report_.largest_force_difference_n) {
    report_.largest_force_difference_n = std::sqrt(squared);
    report_.recorded_force_n = std::sqrt(force);
    report_.largest_at_x_m = recorded.position_m_size() > 0 ? recorded.position_m(0) : 0;
  }
}

void Player::play_estimate(const Call& call) {
  std::map<std::string, const v1::Map*> recorded;
  bool published = false;  // else the call failed when it was recorded, and may fail again
  for (const v1::RecordEntry& entry : call.responses) {
    const v1::EstimateResponse& response = entry.estimate_response();
    published = published || response.has_summary();
    if (response.has_map()) recorded[response.map().map().name()] = &response.map().map();
  }
  const auto stub = v1::Elastography::NewStub(channel_);
  grpc::ClientContext context;
  const v1::Acquisition& first = call.requests.front().estimate_request().acquisition();
  if (first.has_publish()) name_scene(context, played_into(first.publish().scene_id()));
  const auto stream = stub->Estimate(&context);
  for (const v1::RecordEntry& entry : call.requests) {
    if (stop_) break;
    v1::EstimateRequest request = entry.estimate_request();
    if (request.has_acquisition() && request.acquisition().has_publish()) {
      v1::Publish& publish = *request.mutable_acquisition()->mutable_publish();
      publish.set_scene_id(played_into(publish.scene_id()));
    }
    if (request.has_acquisition() && request.acquisition().has_slice_of()) {  // who knows which were there
      request.mutable_acquisition()->clear_slice_of();
      recorded.clear();
      ++report_.alone;
    }
    pace_.wait(entry.monotonic_ns());
    keep(request);
    if (!stream->Write(request)) break;
  }
  if (stop_) context.TryCancel();
  stream->WritesDone();
  v1::EstimateResponse response;
  while (stream->Read(&response)) {
    keep(response);
    if (!response.has_map()) continue;
    const auto partner = recorded.find(response.map().map().name());
    if (partner == recorded.end()) continue;
    compare(response.map().map(), *partner->second, partner->first);
    recorded.erase(partner);
  }
  report_.not_alike += recorded.size();  // maps that did not come this time
  const grpc::Status status = stream->Finish();
  if (!status.ok() && published && !stop_) fail("an Estimate call", status);
  ++report_.requests;
}

template <typename Value>
double largest_difference(const std::string& a, const std::string& b) {
  double difference = 0, scale = 0;
  for (std::size_t offset = 0; offset + sizeof(Value) <= a.size(); offset += sizeof(Value)) {
    Value x, y;
    std::memcpy(&x, a.data() + offset, sizeof(Value));
    std::memcpy(&y, b.data() + offset, sizeof(Value));
    const double gap = std::abs(static_cast<double>(x) - static_cast<double>(y));
    // Where both have no value they agree; where one has, they do not.
    if (std::isnan(gap) && std::isnan(static_cast<double>(x)) != std::isnan(static_cast<double>(y)))
      return INFINITY;
    if (!std::isnan(gap)) difference = std::max(difference, gap);
    if (std::isfinite(static_cast<double>(y))) scale = std::max(scale, std::abs(static_cast<double>(y)));
  }
  return difference == 0 ? 0 : difference / scale;
}

// What all windows together have become.
void Player::compare_scene(const v1::Scene& recorded) {
  v1::Scene scene;
  const grpc::Status status =
      get_scene(*v1::Palpation::NewStub(channel_), scene_id_, v1::SCENE_VIEW_FULL, scene);
  if (!status.ok()) fail("reading the scene", status);
  compare(scene.youngs_modulus(), recorded.youngs_modulus(), "the scene's modulus");
  compare(scene.valid(), recorded.valid(), "the scene's validity");
}

void Player::compare(const v1::Map& map, const v1::Map& recorded, const std::string& name) {
  ++report_.compared;
  const v1::Array& a = map.values();
  const v1::Array& b = recorded.values();
  if (a.dtype() != b.dtype() || a.data().size() != b.data().size()) {
    ++report_.not_alike;
    return;
  }
  double difference = 0;
  if (a.dtype() == v1::DATA_TYPE_FLOAT32) difference = largest_difference<float>(a.data(), b.data());
  if (a.dtype() == v1::DATA_TYPE_FLOAT64) difference = largest_difference<double>(a.data(), b.data());
  if (a.dtype() == v1::DATA_TYPE_UINT8) difference = largest_difference<std::uint8_t>(a.data(), b.data());
  if (a.dtype() == v1::DATA_TYPE_INT16) difference = largest_difference<std::int16_t>(a.data(), b.data());
  if (!(difference <= report_.largest_map_difference)) {
    report_.largest_map_difference = difference;
    report_.largest_map = name;
  }
}

}  // namespace

std::string what_is_not_alike(const ReplayReport& report) {
  if (report.not_alike == 0) return "";
  return std::to_string(report.not_alike) + " of " + std::to_string(report.compared) +
         (report.kind == "acquire" ? " maps" : " answers") +
         " are of another status or size than recorded, no numbers, or did not come: the scene is not as it "
         "was";
}

ReplayReport replay(const ReplayOptions& options, const std::atomic<bool>& stop) {
  require_different_files(
      {{"the recording that is played", options.path}, {"--record", options.record_path}});
  return Player(options, stop).play();
}

}  // namespace teletact::client
