#include "service/imaging/modulus/tissue_words.h"

#include <fmt/format.h>

#include <cmath>
#include <string>

namespace teletact::service {
namespace {

constexpr double kSure = 0.9;          // weight: no other tissue is named
constexpr double kNotedGrading = 0.2;  // of ln E from the face to the bottom of the image

std::string words_of(const CandidateTissue& m, const CandidateTissue& likeliest) {
  if (m.block) return "is a block as wide as the probe, its bottom unseen";
  const std::string end = m.face.goes_on() ? "continues beside the probe"
                          : m.face.beside_m > 0
                              ? fmt::format("ends some {:.0f} mm beside the probe", 1e3 * m.face.beside_m)
                              : "is as wide as the probe";
  const auto other = [&](double ProbeFace::*length) {
    return std::abs(std::log(m.face.*length / (likeliest.face.*length))) > kOtherLength;
  };
  return end + (m.face.slides ? " and slides on its support" : "") +
         (other(&ProbeFace::depth_m) ? fmt::format(" and is {:.0f} mm deep", 1e3 * m.face.depth_m) : "") +
         (other(&ProbeFace::elevation_m) ? fmt::format(" under a face of {:.1f} mm", 1e3 * m.face.elevation_m)
                                         : "");
}

}  // namespace

void put_into_words(const std::vector<WeighedKind>& order, bool fitted, double grading, double above_m,
                    ProbeFit& out) {
  const CandidateTissue& likeliest = *order[0].of;
  const TissueWindow& w = *order[0].window;
  const auto at_fit = [&](double at_m, Eigen::Index column) {
    return fitted && !likeliest.block ? at_m * std::exp(likeliest.fit.at[column]) : at_m;
  };
  const double elevation_m = at_fit(out.face.elevation_m, kElevation),
               depth_m = at_fit(out.face.depth_m, kDepth);
  const auto contradicts = [&](const KnownLength& known, double at_m, const char* what, double more_m = 0) {
    if (!known.contradicted(at_m)) return;
    out.contradicted += fmt::format("{}{} is stated as {:.1f} mm, but the strain shows {:.1f} mm",
                                    out.contradicted.empty() ? "" : "; ", what,
                                    1e3 * (std::exp(known.log) + more_m), 1e3 * (at_m + more_m));
  };
  contradicts(w.elevation, elevation_m, "the face's length across the image");
  if (!likeliest.block) contradicts(w.depth, depth_m, "the tissue's depth", above_m);
  const double pad_m =
      out.face.pad_m > 0 && fitted ? at_fit(out.face.pad_m, pad_column(likeliest.fit)) : out.face.pad_m;
  if (out.face.pad_m > 0) contradicts(w.pad, pad_m, "the pad's thickness");

  const auto origin = [&](const KnownLength& of, double at_m, double more_m = 0) {
    return of.contradicted(at_m) ? fmt::format("stated as {:.1f}", 1e3 * (std::exp(of.log) + more_m))
                                 : std::string(of.stated      ? "stated"
                                               : out.as_usual ? "usual"
                                                              : "fitted");
  };
  std::string tissue = words_of(likeliest, likeliest);
  if (order[0].weight < kSure)
    tissue += fmt::format(" (weight {:.2f}; or {}: {:.2f})", order[0].weight,
                          words_of(*order[1].of, likeliest), order[1].weight);
  const std::string deep = likeliest.block ? ""
                                           : fmt::format(" {:.0f} mm deep ({})", 1e3 * (depth_m + above_m),
                                                         origin(w.depth, depth_m, above_m));
  out.words = fmt::format(
      "solid tissue{} that {}, under a face of {:.1f} x {:.1f} mm ({}): {:.0f} % of the strain unexplained "
      "where it is homogeneous",
      deep, tissue, 1e3 * out.face.width_m, 1e3 * elevation_m, origin(w.elevation, elevation_m),
      100 * out.rest);
  if (out.face.pad_m > 0)
    out.words += fmt::format("; its first {:.1f} mm are the pad ({})", 1e3 * pad_m, origin(w.pad, pad_m));
  if (std::abs(grading) > kNotedGrading)
    out.words +=
        fmt::format("; its modulus {} by a factor of {:.1f} from the face to the bottom of the image",
                    grading < 0 ? "falls" : "rises", std::exp(std::abs(grading)));
}

}  // namespace teletact::service
