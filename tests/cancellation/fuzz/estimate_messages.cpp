#include "tests/cancellation/fuzz/estimate_messages.h"

#include <cstring>
#include <limits>

#include "teletact/v1/elastography.pb.h"
#include "tests/imaging/speckle.h"

namespace teletact::test {

namespace {

using service::Speckle;
using service::SpeckleOptions;

// Bytes of both frames, float32.
struct Pair {
  std::size_t samples = 0, lines = 0;
  std::string pre, post;
};

Pair made(std::size_t samples, std::size_t lines) {
  constexpr double kStrain = -0.012;
  SpeckleOptions options;
  options.samples = samples, options.lines = lines, options.snr_db = 30;
  const Speckle speckle(options);
  const auto frame = [&](double strain, unsigned seed) {
    const auto rf = speckle.frame([strain](double, double y) { return std::pair{0.0, strain * y}; }, seed);
    return std::string(reinterpret_cast<const char*>(rf.samples.data()), rf.samples.size() * sizeof(float));
  };
  return {samples, lines, frame(0, 1), frame(kStrain, 2)};
}

// The smallest that the contract allows, and one that can be tracked.
const Pair& tiny_pair() {
  static const Pair pair = made(64, 8);
  return pair;
}
const Pair& small_pair() {
  static const Pair pair = made(640, 48);
  return pair;
}

v1::Acquisition acquisition_of(const Pair& pair, const std::string& scene, Random& random) {
  const auto g = service::speckle_geometry();
  v1::Acquisition a;
  a.set_sample_count(static_cast<unsigned>(pair.samples));
  a.set_line_count(static_cast<unsigned>(pair.lines));
  a.set_dtype(v1::DATA_TYPE_FLOAT32);
  a.set_center_frequency_hz(g.center_frequency_hz);
  a.set_sampling_frequency_hz(g.sampling_frequency_hz);
  a.set_sound_speed_m_s(1540);
  a.set_line_pitch_m(g.line_pitch_m);
  a.set_displacement_frame(v1::DISPLACEMENT_FRAME_PROBE);
  a.mutable_probe_force()->set_force_n(1.0);
  a.mutable_probe_force()->set_contact_area_m2(static_cast<double>(pair.lines) * g.line_pitch_m * 0.01);
  a.set_modulus_method(static_cast<v1::ModulusMethod>(random.below(4)));
  a.set_modulus_time_limit_s(random.within(0.01, 0.2));
  if (random.chance(0.3)) a.set_finish_within_s(random.one_of(std::array{1e-6, 0.01, 1.0, 10.0}));
  if (random.chance(0.2)) a.set_max_strain(random.within(0.02, 0.12));
  if (random.chance(0.5)) {
    a.mutable_publish()->set_scene_id(scene);
    for (const double origin_m : {random.within(0, 0.02), 0.0})
      a.mutable_publish()->mutable_window()->add_origin_m(origin_m);
  }
  return a;
}

double impossible_number(Random& random) {
  using Limits = std::numeric_limits<double>;
  return random.one_of(std::array{Limits::quiet_NaN(), Limits::infinity(), -1.0, 1e300});
}

void spoil(v1::SlicePose& window, Random& random) {
  const auto vector =
      random.one_of(std::array{window.mutable_origin_m(), window.mutable_lateral(), window.mutable_axial()});
  vector->Resize(static_cast<int>(random.below(5)), 0.01);
  vector->Add(impossible_number(random));
}

void spoil(v1::Acquisition& a, Random& random) {
  switch (random.below(16)) {
    case 0:
      return a.set_sample_count(random.one_of(std::array{0U, 63U, 16385U, 0xffffffffU}));
    case 1:
      return a.set_line_count(random.one_of(std::array{0U, 7U, 2049U, 0xffffffffU}));
    case 2:
      a.set_sample_count(16384);  // beyond max_frame_bytes
      return a.set_line_count(2048);
    case 3:
      return a.set_dtype(static_cast<v1::DataType>(random.below(9)));
    case 4:
      return a.set_center_frequency_hz(impossible_number(random));
    case 5:
      return a.set_sampling_frequency_hz(impossible_number(random));
    case 6:
      return a.set_sound_speed_m_s(impossible_number(random));
    case 7:
      return a.set_line_pitch_m(impossible_number(random));
    case 8:
      return a.set_displacement_frame(v1::DISPLACEMENT_FRAME_UNSPECIFIED);
    case 9:
      return a.mutable_probe_force()->set_force_n(impossible_number(random));
    case 10:
      return a.mutable_publish()->set_scene_id("no-such-scene");
    case 11:
      a.mutable_publish()->set_scene_id("small");
      return spoil(*a.mutable_publish()->mutable_window(), random);
    case 12:
      return a.add_maps("no_such_map");
    case 13:
      return a.set_modulus_time_limit_s(impossible_number(random));
    case 14:
      return a.set_finish_within_s(impossible_number(random));
    default:
      return a.set_poisson_ratio(impossible_number(random));
  }
}

Message message_of(const v1::EstimateRequest& request) {
  return {[bytes = request.SerializeAsString()](std::uint64_t) { return bytes; }, 0};
}

Message chunk(v1::FrameKind frame, std::size_t offset, const std::string& data) {
  v1::EstimateRequest request;
  request.mutable_chunk()->set_frame(frame);
  request.mutable_chunk()->set_offset_bytes(offset);
  request.mutable_chunk()->set_data(data);
  return message_of(request);
}

void add_frame(Script& script, v1::FrameKind kind, const std::string& bytes) {
  const std::size_t length = bytes.size() < 4096 ? 1024 : 65536;
  for (std::size_t at = 0; at < bytes.size(); at += length)
    script.messages.push_back(chunk(kind, at, bytes.substr(at, length)));
}

// Wrong after the acquisition.
void spoil(Script& script, const Pair& pair, Random& random) {
  auto& messages = script.messages;
  switch (random.below(7)) {
    case 0:  // the acquisition never comes
      messages.erase(messages.begin());
      return;
    case 1:
      messages.insert(messages.begin() + 1, messages.front());
      return;
    case 2:
      messages.back() = chunk(v1::FRAME_KIND_POST, 1, "xy");
      return;
    case 3:
      messages.back() = chunk(static_cast<v1::FrameKind>(77), 0, "xy");
      return;
    case 4:
      messages.push_back(chunk(v1::FRAME_KIND_POST, pair.post.size(), "more"));
      return;
    case 5:
      messages.pop_back();
      return;
    default: {  // not a number
      std::string bytes = pair.pre;
      const float nan = std::numeric_limits<float>::quiet_NaN();
      std::memcpy(bytes.data(), &nan, sizeof nan);
      messages[1] = chunk(v1::FRAME_KIND_PRE, 0, bytes.substr(0, 1024));
    }
  }
}

}  // namespace

void make_pairs() {
  tiny_pair();
  small_pair();
}

Script estimate_script(const Case& tried, const std::string& scene, Random& random) {
  const bool invalid = tried.content == Content::kInvalid;
  const Pair& pair =
      !invalid && random.chance(tried.end == End::kHalfClose ? 0.2 : 0.03) ? small_pair() : tiny_pair();
  v1::EstimateRequest first;
  *first.mutable_acquisition() = acquisition_of(pair, scene, random);
  const bool bad_acquisition = invalid && random.chance(0.5);
  if (bad_acquisition) spoil(*first.mutable_acquisition(), random);
  Script script;
  script.messages.push_back(message_of(first));
  if (tried.content == Content::kEmpty) {
    if (random.chance(0.5)) script.messages.clear();
    if (random.chance(0.5))
      script.messages.push_back({[](std::uint64_t) { return std::string(); }, 0});
    else  // a chunk that brings nothing
      script.messages.push_back(chunk(v1::FRAME_KIND_PRE, 0, ""));
    return script;
  }
  add_frame(script, v1::FRAME_KIND_PRE, pair.pre);
  add_frame(script, v1::FRAME_KIND_POST, pair.post);
  if (invalid && !bad_acquisition) spoil(script, pair, random);
  return script;
}

}  // namespace teletact::test
