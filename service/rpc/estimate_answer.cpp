#include "service/rpc/estimate_answer.h"

#include <fmt/format.h>

#include <string>
#include <type_traits>
#include <variant>

#include "service/imaging/maps.h"
#include "service/rpc/map_message.h"

namespace teletact::service {

namespace {

void map_to(const Estimate& e, const EstimateMap& map, v1::Map* out) {
  const char* unit = map.unit ? map.unit : e.modulus.absolute ? "Pa" : "1";
  std::visit(
      [&](auto values) {
        if constexpr (std::is_same_v<decltype(values), BMode Estimate::*>)
          map_to(map.name, unit, (e.*values).grid, (e.*values).grey, out);
        else if constexpr (std::is_same_v<decltype(values), Field ModulusEstimate::*>)
          map_to(map.name, unit, e.grid, e.modulus.*values, out);
        else
          map_to(map.name, unit, e.grid, e.*values, out);
      },
      map.values);
}

v1::ModulusMethod method_to(ModulusKind kind) {
  switch (kind) {
    case ModulusKind::kReferenceStress:
      return v1::MODULUS_METHOD_REFERENCE_STRESS;
    case ModulusKind::kDirect:
      return v1::MODULUS_METHOD_DIRECT;
    case ModulusKind::kIterative:
      return v1::MODULUS_METHOD_ITERATIVE;
    case ModulusKind::kSolid:
      return v1::MODULUS_METHOD_SOLID;
  }
  return v1::MODULUS_METHOD_UNSPECIFIED;
}

void estimate_to(const Estimate& e, v1::EstimateSummary* out) {
  out->set_modulus_absolute(e.modulus.absolute);
  out->set_median_correlation(e.median_correlation);
  out->set_quality(e.quality);
  out->set_valid_fraction(e.valid_fraction);
  out->set_mean_axial_strain(e.modulus.mean_axial_strain);
  out->set_background_modulus_pa(e.modulus.background);
  out->set_youngs_modulus_correlation_m(e.modulus.correlation_m);
  out->set_modulus_method(method_to(e.modulus.kind));
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
  switch (stage) {
    case Stage::kDisplacement:
      return v1::ESTIMATE_STAGE_DISPLACEMENT;
    case Stage::kStrain:
      return v1::ESTIMATE_STAGE_STRAIN;
    case Stage::kModulus:
      return v1::ESTIMATE_STAGE_MODULUS;
  }
  return v1::ESTIMATE_STAGE_UNSPECIFIED;
}

const char* name_of(Stage stage) {
  switch (stage) {
    case Stage::kDisplacement:
      return "displacement";
    case Stage::kStrain:
      return "strain";
    case Stage::kModulus:
      return "modulus";
  }
  return "unknown";
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
