// Estimate: what a client says of its RF pair, and the pair's chunks.
#include "service/rpc/estimate_messages.h"

#include <cmath>

#include "service/scene/errors.h"
#include "tests/fuzzers/service/fuzzers.h"
#include "tests/fuzzers/support/delimited.h"
#include "tests/scene/create_scene.h"
#include "tests/scene/windows.h"

namespace teletact::fuzzers {
namespace {

using namespace service;

// An empty scene "s", and a solid "solid".
struct Known {
  Scenes scenes{""};
  Known() {
    const SceneGeometry geometry = tissue(0.1, 0.02);
    create_scene(scenes, "s", geometry, std::nullopt);
    create_scene(
        scenes, "solid", geometry,
        ExplicitModulus{{0, 0.05, 0.1}, {0, 0.01, 0.02}, std::vector<double>(8, 1e4), {-0.01, 0, 0.01}});
  }
};

void check(const EstimateRequest& r, const Limits& limits) {
  require(r.sample_count >= limits.min_samples && r.sample_count <= limits.max_samples &&
              r.line_count >= limits.min_lines && r.line_count <= limits.max_lines,
          "samples beyond the limits");
  require(!r.maps.empty(), "no map is wanted");
  const AcquisitionGeometry& g = r.geometry;
  for (const double number :
       {g.center_frequency_hz, g.sampling_frequency_hz, g.sound_speed_m_s, g.line_pitch_m, r.max_strain,
        r.tissue.depth_m, r.tissue.width_m, r.window_width_m()})
    require(number > 0 && std::isfinite(number), "a length, a frequency or a strain that is not positive");
  require(std::isfinite(r.window_x_m) && std::isfinite(r.tissue.window_x_m), "a window that is nowhere");
  require(r.tissue.poisson_ratio >= 0 && r.tissue.poisson_ratio < 0.5, "a Poisson ratio that cannot be");
  if (!r.force) return;
  require(r.force->force_n > 0 && r.force->contact_area_m2 > 0, "a force or an area that is not positive");
  for (const double deviation : {r.force_relative_deviation, r.area_relative_deviation})
    require(deviation >= 0 && deviation < 2, "a deviation beyond the value itself");
}

void check(const RfFrame& frame, const EstimateRequest& request) {
  require(frame.samples.size() == request.samples(), "a frame of another size");
  for (const float sample : frame.samples) require(std::isfinite(sample), "a sample that is not finite");
}

}  // namespace

bool acquisition(Bytes bytes) {
  static const Limits limits;
  static const Known known;
  Delimited requests(bytes);
  const auto first = requests.next<v1::EstimateRequest>();
  if (!first) return false;
  EstimateRequest request;
  if (!accepted<std::invalid_argument, Error>(
          [&] { request = request_from(first->acquisition(), known.scenes, limits); }))
    return false;
  check(request, limits);
  FrameUpload upload(request, first->acquisition().dtype(), limits.max_chunk_bytes);
  require(upload.frame_bytes() > 0 && upload.frame_bytes() <= limits.max_frame_bytes,
          "a frame beyond the limits");
  std::pair<RfFrame, RfFrame> frames;
  if (!accepted<std::invalid_argument>([&] {
        while (const auto next = requests.next<v1::EstimateRequest>()) upload.add(next->chunk());
        frames = upload.finish();
      }))
    return false;
  check(frames.first, request);
  check(frames.second, request);
  return true;
}

}  // namespace teletact::fuzzers
