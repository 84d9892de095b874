// Touch: what a stream is opened with, and its poses.
#include <cmath>

#include "service/rpc/touch_messages.h"
#include "service/scene/errors.h"
#include "tests/fuzzers/service/fuzzers.h"
#include "tests/fuzzers/support/delimited.h"
#include "tests/scene/create_scene.h"
#include "tests/scene/windows.h"

namespace teletact::fuzzers {
namespace {

using namespace service;

// A plane scene, or a solid, of a few elements.
std::shared_ptr<Scene> scene(bool solid) {
  static Scenes scenes("");
  const SceneGeometry geometry = tissue(0.04, 0.02);
  static const auto plane =
      create_scene(scenes, "plane", geometry,
                   ExplicitModulus{{0, 0.02, 0.04}, {0, 0.01, 0.02}, std::vector<double>(4, 1e4)});
  static const auto block = create_scene(
      scenes, "solid", geometry,
      ExplicitModulus{{0, 0.02, 0.04}, {0, 0.01, 0.02}, std::vector<double>(8, 1e4), {-0.02, 0, 0.02}});
  return solid ? block : plane;
}

void check(const TouchStream& stream, const Limits& limits) {
  require(stream.credit() >= 1 && stream.credit() <= limits.max_credit, "a credit beyond the limits");
  require(stream.period() > TouchStream::Clock::duration::zero(), "a period of nothing");
  const Layer& layer = stream.layer();
  require(std::isfinite(layer.depth_m) && layer.depth_m >= 0, "a layer that is nowhere");
  require(std::abs(std::hypot(layer.normal[0], layer.normal[1], layer.normal[2]) - 1) < 1e-9,
          "a normal that is no unit vector");
  const Region covered = stream.covered();
  require(covered.begin_x_m <= covered.end_x_m, "a region that ends before it begins");
}

}  // namespace

bool touch_open(Bytes bytes) {
  require_plain_log();
  static const CurrentDevice no_device{nullptr};
  Delimited requests(bytes);
  const auto first = requests.next<v1::TouchRequest>();
  if (!first) return false;
  const auto touched = scene(first->open().scene_id() == "solid");
  std::optional<TouchStream> stream;
  if (!accepted<std::invalid_argument, Error>(
          [&] { stream.emplace(touched, stream_options_from(first->open()), no_device); }))
    return false;
  check(*stream, touched->limits());
  while (const auto next = requests.next<v1::TouchRequest>()) {
    if (next->has_hand_over()) stream->hand_over(next->hand_over().session_id());
    if (!next->has_pose()) continue;
    FingerPose pose;
    if (!accepted<std::invalid_argument, Error>([&] {
          pose = pose_from(next->pose());
          stream->bring(pose);
        }))
      continue;
    for (const double at : pose.position_m) require(std::isfinite(at), "a place that is not finite");
    for (const double at : pose.velocity_m_s) require(std::isfinite(at), "a velocity that is not finite");
    require(pose.components == 2 || pose.components == 3, "a place of other dimensions");
  }
  return true;
}

}  // namespace teletact::fuzzers
