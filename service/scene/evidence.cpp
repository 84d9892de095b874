#include "service/scene/evidence.h"

#include <algorithm>
#include <array>

namespace teletact::service {

namespace {

struct Effect {
  std::string_view flag;
  FlagEffect effect;
};

// The one place that says it; docs/guide/recorded-data.md shows the same.
constexpr std::array<Effect, 14> kEffects{{
    {"wrong-force", FlagEffect::kDegrade},  // the force may be off by any factor
    {"misfit", FlagEffect::kDegrade},       // no modulus explains what was measured
    // Each touch judges the tissue that it feels itself: choices::kTrustedShare.
    {"untracked", FlagEffect::kRemark},
    {"noise", FlagEffect::kRemark},
    {"streaks", FlagEffect::kRemark},
    {"ramp", FlagEffect::kRemark},
    {"out-of-plane", FlagEffect::kRemark},
    {"pressure", FlagEffect::kRemark},
    {"extent", FlagEffect::kRemark},
    {"deadline", FlagEffect::kRemark},
    {"displacement", FlagEffect::kRemark},
    {"displacement_frame", FlagEffect::kRemark},
    {"center_frequency_hz", FlagEffect::kRemark},
    {kLoneFlag, FlagEffect::kRemark},
}};

}  // namespace

std::string_view flag_of(std::string_view warning) {
  return warning.substr(0, warning.find(':'));
}

FlagEffect effect_of(std::string_view flag) {
  const auto found = std::find_if(kEffects.begin(), kEffects.end(),
                                  [flag](const Effect& effect) { return effect.flag == flag; });
  return found == kEffects.end() ? FlagEffect::kRemark : found->effect;
}

}  // namespace teletact::service
