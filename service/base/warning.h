// Reasons to doubt an estimate, and what each does to a touch: the one list of their names, for answers,
// files and the log. Those of docs/guide/recorded-data.md and of the contract (EstimateSummary.warnings) are
// tested to be these.
#pragma once

#include <array>
#include <string>
#include <string_view>

namespace teletact::service {

enum class WarningFlag {
  // Of the modulus (T3.4).
  kNoise,       // the standard deviation of log E is large
  kStreaks,     // the strain hardly determines the modulus somewhere: det A near 0, mu not positive
  kUntracked,   // part of the window was not tracked; it says nothing
  kRamp,        // the map ramps across the window: the traction is not that of a flat frictionless probe
  kOutOfPlane,  // lateral strain is not what the plane assumption says
  kPressure,    // the load is carried by pressure, which nu sets and no displacement tells: nu -> 1/2
  kExtent,      // much of the window is no background: its contrast comes back short
  kScale,       // the modulus is another by a factor than the neighbours told: a wrong force
  kMisfit,      // no modulus explains the displacement within its noise
  kDeadline,    // it did not settle
  kElevation,   // what is stated of face and depth contradicts the strain
  kCut,         // of its plan not all was afforded
  kModels,      // the strain does not tell models of the tissue apart that differ in the modulus
  kUnstated,    // what was not stated of face and tissue, or not well, leaves the modulus open
  // Of the frames, and of what is stated of them.
  kImage,              // they do not oscillate along depth: no RF
  kAxis,               // they do across the lines
  kCoupling,           // what lies above the tissue is left out
  kDisplacement,       // a system of equations was left unsolved
  kDisplacementFrame,  // the other side rests
  kCenterFrequency,    // the echoes have another
  // Of a published window.
  kLone,   // no neighbour to compare with
  kState,  // it could not be kept on disk
  kLast = kState
};

struct WarningKind {
  const char* name;
  // Answers of such a window are not to be trusted: the force may be off by any factor, no modulus explains
  // what was measured, or the frames were no RF, or lay across the axes. All other warnings are said, and the
  // answer stands; untracked tissue each touch judges itself (choices::kTrustedShare).
  bool degrades = false;
};

inline constexpr std::array<WarningKind, static_cast<std::size_t>(WarningFlag::kLast) + 1> kWarnings{
    {{"noise"},
     {"streaks"},
     {"untracked"},
     {"ramp"},
     {"out-of-plane"},
     {"pressure"},
     {"extent"},
     {"wrong-force", true},
     {"misfit", true},
     {"deadline"},
     {"elevation"},
     {"cut"},
     {"models"},
     {"unstated"},
     {"image", true},
     {"axis", true},
     {"coupling"},
     {"displacement"},
     {"displacement_frame"},
     {"center_frequency_hz"},
     {"lone"},
     {"state"}}};

constexpr const char* name_of(WarningFlag flag) {
  return kWarnings[static_cast<std::size_t>(flag)].name;
}

struct Warning {
  WarningFlag flag;
  std::string text;
  // As answers and files have it.
  std::string line() const { return std::string(name_of(flag)) + ": " + text; }
};

// The name of a warning's line, what stands before its colon.
inline std::string_view flag_of(std::string_view line) {
  return line.substr(0, line.find(':'));
}

inline bool degrades(std::string_view flag) {
  for (const WarningKind& kind : kWarnings)
    if (flag == kind.name) return kind.degrades;
  return false;
}

}  // namespace teletact::service
