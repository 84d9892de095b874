#include "service/rpc/estimate_messages.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <variant>

#include "service/device/cancellation.h"
#include "service/imaging/maps.h"
#include "service/rpc/palpation_messages.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

void check_frame_bytes(const v1::Acquisition& in, const Limits& limits) {
  if (in.dtype() != v1::DATA_TYPE_INT16 && in.dtype() != v1::DATA_TYPE_FLOAT32)
    throw std::invalid_argument("acquisition.dtype: must be INT16 or FLOAT32");
  const auto bytes =
      static_cast<unsigned __int128>(in.sample_count()) * in.line_count() * bytes_per_item(in.dtype());
  if (bytes > limits.max_frame_bytes)
    throw Error(
        ErrorKind::kExhausted,
        fmt::format(
            "acquisition.sample_count, acquisition.line_count: {} x {} samples are more than the {} bytes "
            "a frame may have; crop the frame",
            in.sample_count(), in.line_count(), limits.max_frame_bytes));
}

constexpr std::array kFrames{v1::DISPLACEMENT_FRAME_LAB,
                             v1::DISPLACEMENT_FRAME_PROBE};  // by DisplacementFrame
constexpr std::array kMethods{v1::MODULUS_METHOD_REFERENCE_STRESS, v1::MODULUS_METHOD_DIRECT,
                              v1::MODULUS_METHOD_ITERATIVE, v1::MODULUS_METHOD_SOLID};  // by ModulusKind
constexpr std::array kPlanes{v1::PLANE_CONDITION_STRAIN, v1::PLANE_CONDITION_STRESS,
                             v1::PLANE_CONDITION_SOLID};  // by Plane
constexpr std::array kSurfaces{v1::SURFACE_KIND_UNSPECIFIED, v1::SURFACE_KIND_BARE, v1::SURFACE_KIND_CAPSULE,
                               v1::SURFACE_KIND_UNEVEN};  // by Surface::Kind
constexpr std::array kStages{v1::ESTIMATE_STAGE_DISPLACEMENT, v1::ESTIMATE_STAGE_STRAIN,
                             v1::ESTIMATE_STAGE_MODULUS};  // by Stage

std::optional<ModulusKind> modulus_kind_from(v1::ModulusMethod in) {
  if (in == v1::MODULUS_METHOD_UNSPECIFIED) return std::nullopt;
  return value_from<ModulusKind>(kMethods, in,
                                 "acquisition.modulus_method: unknown; leave it out or use REFERENCE_STRESS, "
                                 "DIRECT, ITERATIVE or SOLID");
}

// Each at most once: the answer is as large as what is asked for.
std::vector<std::string> maps_from(const v1::Acquisition& in) {
  std::vector<std::string> maps;
  std::vector<std::string> known;
  for (const EstimateMap& map : kEstimateMaps) known.emplace_back(map.name);
  for (const std::string& map : in.maps()) {
    if (!find_map(map))
      throw std::invalid_argument(fmt::format("acquisition.maps: \"{}\" is unknown; give one of {}",
                                              shown(map), fmt::join(known, ", ")));
    if (std::find(maps.begin(), maps.end(), map) != maps.end())
      throw std::invalid_argument(fmt::format("acquisition.maps: \"{}\" twice; ask for it once", map));
    maps.push_back(map);
  }
  return maps.empty() ? known : maps;
}

// Where a window begins: at the scene's surface, along its axes, along x anywhere; across a solid's z, too.
std::array<double, 3> origin_from(const std::string& field, const v1::SlicePose& in, bool solid) {
  const auto origin_m = origin_along_axes(field, in, "windows");
  for (const std::size_t axis : {1U, 2U})
    if (origin_m[axis] != 0 && !(solid && axis == 2))
      throw std::invalid_argument(
          fmt::format("{}.origin_m[{}]: {}; windows begin at the scene's surface{}: give [x, 0, {}]", field,
                      axis, origin_m[axis], solid ? "" : " and lie in its plane", solid ? "z" : "0"));
  return origin_m;
}

EstimateRequest stated_in(const v1::Acquisition& in, const Scenes& scenes) {
  EstimateRequest request;
  request.sample_count = in.sample_count();
  request.line_count = in.line_count();
  request.geometry = {in.center_frequency_hz(),
                      in.sampling_frequency_hz(),
                      in.sound_speed_m_s(),
                      in.line_pitch_m(),
                      in.first_sample_depth_m(),
                      value_from<DisplacementFrame>(
                          kFrames, in.displacement_frame(),
                          "acquisition.displacement_frame: must be stated; LAB where the far side rests, "
                          "PROBE where the probe face rests")};
  if (in.has_probe_force()) {
    request.force = {in.probe_force().force_n(), in.probe_force().contact_area_m2()};
    request.force_std_n = in.probe_force().force_std_n();
    request.contact_area_std_m2 = in.probe_force().contact_area_std_m2();
    request.force_zero_n = in.probe_force().force_zero_n();
    request.force_zero_std_n = in.probe_force().force_zero_std_n();
    request.force_gain = in.probe_force().force_gain();
    request.force_gain_std = in.probe_force().force_gain_std();
  }
  const Plane plane =
      in.plane() == v1::PLANE_CONDITION_UNSPECIFIED
          ? Plane::kStrain
          : value_from<Plane>(kPlanes, in.plane(),
                              "acquisition.plane: unknown; leave it out or use STRAIN, STRESS or SOLID");
  request.tissue = {in.tissue_width_m(),   in.tissue_depth_m(), 0, in.poisson_ratio(), plane,
                    in.probe_elevation_m()};
  request.tissue.probe_elevation_std_m = in.probe_elevation_std_m();
  request.tissue.depth_std_m = in.tissue_depth_std_m();
  request.tissue.surface = {
      value_from<Surface::Kind>(kSurfaces, in.surface(),
                                "acquisition.surface: unknown; leave it out or use BARE, CAPSULE or UNEVEN"),
      in.capsule_thickness_m(), in.capsule_ratio(), in.capsule_thickness_std_m(), in.capsule_ratio_std()};
  if (in.pad_thickness_m() != 0 || in.pad_youngs_modulus_pa() != 0 || in.pad_thickness_std_m() != 0 ||
      in.pad_youngs_modulus_std_pa() != 0)
    request.tissue.pad = {in.pad_thickness_m(), in.pad_youngs_modulus_pa(), in.pad_thickness_std_m(),
                          in.pad_youngs_modulus_std_pa()};
  request.tissue.poisson_std = in.poisson_ratio_std();
  request.tissue_width_std_m = in.tissue_width_std_m();
  request.sound_speed_std_m_s = in.sound_speed_std_m_s();
  request.preload_m = in.preload_m();
  request.preload_std_m = in.preload_std_m();
  request.max_strain = in.max_strain();
  request.modulus.kind = modulus_kind_from(in.modulus_method());
  if (in.modulus_time_limit_s() != 0) request.modulus_time_limit_s = in.modulus_time_limit_s();
  request.finish_within_s = in.finish_within_s();
  if (in.has_publish()) {
    request.scene = scenes.find(in.publish().scene_id());
    request.window_x_m = origin_from("publish.window", in.publish().window(), false)[0];
  }
  if (in.has_slice_of()) {
    const auto origin_m = origin_from("slice_of.window", in.slice_of().window(), true);
    request.slice_of = {scenes.find(in.slice_of().scene_id()), origin_m[0], origin_m[2]};
  }
  request.maps = maps_from(in);
  return request;
}

}  // namespace

EstimateRequest request_from(const v1::Acquisition& in, const Scenes& scenes, const Limits& limits) {
  check_frame_bytes(in, limits);
  EstimateRequest request = stated_in(in, scenes);
  // Windows of a scene keep theirs, for observers.
  request.b_mode = request.scene || std::ranges::find(request.maps, "b_mode") != request.maps.end();
  settle(request, limits);
  return request;
}

FrameUpload::FrameUpload(const EstimateRequest& request, v1::DataType of_samples, std::size_t max_chunk_bytes)
    : samples_(request.sample_count),
      lines_(request.line_count),
      frame_bytes_(request.samples() * bytes_per_item(of_samples)),
      max_chunk_bytes_(max_chunk_bytes),
      dtype_(of_samples) {}

void FrameUpload::add(const v1::FrameChunk& chunk) {
  if (chunk.frame() != v1::FRAME_KIND_PRE && chunk.frame() != v1::FRAME_KIND_POST)
    throw std::invalid_argument("chunk.frame: must be PRE or POST");
  std::string& frame = chunk.frame() == v1::FRAME_KIND_PRE ? pre_ : post_;
  if (chunk.data().size() > max_chunk_bytes_)
    throw std::invalid_argument(fmt::format("chunk.data: {} bytes, at most {} per chunk; send smaller ones",
                                            chunk.data().size(), max_chunk_bytes_));
  if (chunk.offset_bytes() != frame.size())
    throw std::invalid_argument(
        fmt::format("chunk.offset_bytes: {}, but {} bytes of the frame have come; send the chunks "
                    "in order",
                    chunk.offset_bytes(), frame.size()));
  if (frame.size() + chunk.data().size() > frame_bytes_)
    throw std::invalid_argument(
        fmt::format("chunk.data: more than the {} bytes that sample_count x line_count declare; "
                    "both frames must be of that size",
                    frame_bytes_));
  frame += chunk.data();
}

void FrameUpload::require_whole() const {
  require_whole("pre", pre_);
  require_whole("post", post_);
}

void FrameUpload::require_whole(const char* name, const std::string& bytes) const {
  if (bytes.size() != frame_bytes_)
    throw std::invalid_argument(
        fmt::format("chunk.data: the {} frame has {} of {} bytes; send the rest before closing", name,
                    bytes.size(), frame_bytes_));
}

std::pair<RfFrame, RfFrame> FrameUpload::finish() {
  RfFrame pre = frame("pre", pre_);
  return {std::move(pre), frame("post", post_)};
}

RfFrame FrameUpload::frame(const char* name, std::string& bytes) const {
  require_whole(name, bytes);
  RfFrame frame{samples_, lines_, {}};
  frame.samples.reserve(samples_ * lines_);
  std::vector<std::int16_t> values(samples_);
  std::vector<float> line(samples_);
  // Beyond, sums of squares over a window leave the range of float and the correlation means nothing.
  constexpr float kLargestSample = 1e15F;
  for (std::size_t l = 0; l < lines_; ++l) {
    check_cancelled();
    const std::size_t each = samples_ * bytes_per_item(dtype_);
    if (dtype_ == v1::DATA_TYPE_FLOAT32) {
      std::memcpy(line.data(), bytes.data() + l * each, each);
    } else {
      std::memcpy(values.data(), bytes.data() + l * each, each);
      std::copy(values.begin(), values.end(), line.begin());
    }
    const auto bad =
        std::find_if(line.begin(), line.end(), [](float s) { return !(std::abs(s) <= kLargestSample); });
    if (bad != line.end())
      throw std::invalid_argument(fmt::format(
          "chunk.data: sample {} of A-line {} of the {} frame is {}, no finite number of at most {} "
          "in size; replace or crop it",
          bad - line.begin(), l, name, *bad, kLargestSample));
    frame.samples.insert(frame.samples.end(), line.begin(), line.end());
  }
  bytes = {};  // the copy is no longer needed
  return frame;
}

namespace {

void modes_to(const char* name, const char* unit, const LogModes& modes, v1::Map* out) {
  map_to(name, unit, modes.grid, modes.values, out);
  const auto count = static_cast<std::uint32_t>(modes.count());
  auto* grid = out->mutable_grid();
  grid->add_size(count), grid->add_origin_m(0), grid->add_spacing_m(1);
  auto* shape = out->mutable_values()->mutable_shape();
  *shape->Add() = count;
  std::ranges::rotate(*shape, shape->end() - 1);
}

void map_to(const Estimate& e, const EstimateMap& map, v1::Map* out) {
  const char* unit = map.unit ? map.unit : e.modulus.absolute ? "Pa" : "1";
  std::visit(
      [&](auto values) {
        if constexpr (std::is_same_v<decltype(values), BMode Estimate::*>)
          map_to(map.name, unit, (e.*values).grid, (e.*values).grey, out);
        else if constexpr (std::is_same_v<decltype(values), LogModes ModulusEstimate::*>)
          modes_to(map.name, unit, e.modulus.*values, out);
        else if constexpr (std::is_same_v<decltype(values), Field ModulusEstimate::*>)
          map_to(map.name, unit, e.grid, e.modulus.*values, out);
        else
          map_to(map.name, unit, e.grid, e.*values, out);
      },
      map.values);
}

void estimate_to(const Estimate& e, v1::EstimateSummary* out) {
  out->set_modulus_absolute(e.modulus.absolute);
  out->set_median_correlation(e.median_correlation);
  out->set_quality(e.quality);
  out->set_valid_fraction(e.valid_fraction);
  out->set_mean_axial_strain(e.modulus.mean_axial_strain);
  out->set_background_modulus_pa(e.modulus.background);
  out->set_youngs_modulus_correlation_m(e.modulus.correlation_m);
  out->set_youngs_modulus_log_std(e.modulus.median_deviation);
  out->set_youngs_modulus_common_log_std(e.modulus.common_deviation);
  out->set_modulus_method(message_of(kMethods, e.modulus.kind));
  out->set_modulus_converged(e.modulus.converged);
  out->set_modulus_model(e.modulus.model.empty() ? e.modulus.why : e.modulus.model);
  out->set_modulus_iterations(static_cast<std::uint32_t>(e.modulus.iterations));
  for (const std::string& warning : warnings_of(e)) out->add_warnings(warning);
}

void add_stage(v1::EstimateSummary* summary, const char* name, double s) {
  v1::StageTime* time = summary->add_stages();
  time->set_stage(name);
  time->set_seconds(s);
}

void summary_to(const EstimateOutcome& outcome, const EstimateRequest& request,
                v1::EstimateSummary* summary) {
  const Estimate& e = outcome.estimate;
  estimate_to(e, summary);
  add_stage(summary, "queued", outcome.queued_s);
  if (outcome.waited_s > 0) add_stage(summary, "waited", outcome.waited_s);
  add_stage(summary, "displacement", e.displacement_s);
  add_stage(summary, "strain", e.strain_s);
  add_stage(summary, "modulus", e.modulus_s);
  if (!outcome.published) return;
  for (const std::string& warning : outcome.published->warnings) summary->add_warnings(warning);
  add_stage(summary, "publish", outcome.publish_s);
  summary->set_scene_id(request.scene->id());
  summary->set_window_id(outcome.published->window_id);
  summary->set_scene_version(outcome.published->version);
  summary->set_received_to_published_s(outcome.received_to_published_s);
}

}  // namespace

v1::EstimateStage stage_to(Stage stage) {
  return message_of(kStages, stage);
}

const char* name_of(Stage stage) {
  return std::array{"displacement", "strain", "modulus"}.at(static_cast<std::size_t>(stage));
}

bool answer_to(const EstimateOutcome& outcome, const EstimateRequest& request, std::size_t index,
               v1::EstimateResponse* out) {
  out->Clear();
  if (index > request.maps.size()) return false;
  if (index < request.maps.size())
    map_to(outcome.estimate, *find_map(request.maps[index]), out->mutable_map()->mutable_map());
  else
    summary_to(outcome, request, out->mutable_summary());
  return true;
}

}  // namespace teletact::service
