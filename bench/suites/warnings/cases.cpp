#include "bench/suites/warnings/cases.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <random>

#include "client/patient/solid_press.h"
#include "client/patient/true_modulus.h"

namespace teletact::bench {
namespace {

using client::Support;
using client::Tissue;
using service::ModulusKind;
using service::WarningFlag;

// A window and the tissue under it, all in proportion to its size but what the image resolves.
struct Site {
  service::ImageGrid image;
  double size;  // of 60 x 40 mm
  double elevation_m;
  double spacing_m;
  double width_m() const { return 0.060 * size; }
  double depth_m() const { return 0.040 * size; }
  double tissue_width_m() const { return 0.120 * size; }
  double push_m() const { return 0.8e-3 * size; }
  double preload_m() const { return 1.5e-3 * size; }
};
// An estimate of a small one takes an eighth of the time of one of 60 x 40 mm, and pressing it, too.
constexpr service::ImageGrid kSmallImage{63, 49, 0.35e-3, 0.2e-3, 0.47e-3, 0.404e-3};
constexpr Site kSmall{kSmallImage, 0.5, 0.010, 0.0015}, kShortFace{kSmallImage, 0.5, 0.007, 0.0015};
constexpr Site kLarge{kGivenImage, 1, 0.010, 0.003};  // pressed in as many elements, for its price

std::uint64_t tissue_of(std::uint64_t seed) {
  return (seed - 1) / kCasesOfTissue + 1;
}

// Solid tissue that an estimate is made for: 3 % friction and all, but nothing that it does not have.
Tissue plain(const Site& site, std::uint64_t seed) {
  std::mt19937_64 random(seed * 7919 + 3);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  Tissue t;
  t.width_m = site.tissue_width_m(), t.depth_m = site.depth_m(), t.seed = seed;
  t.probe.width_m = site.width_m(), t.probe.elevation_m = site.elevation_m;
  t.probe.compression_m = site.push_m();
  client::Solid solid;
  solid.elevational_width_m = site.tissue_width_m(), solid.preload_m = site.preload_m();
  solid.friction = between(0, 0.3), solid.uneven = between(-0.1, 0.1), solid.texture = between(0, 0.1);
  client::Inclusion lump;
  lump.x_m = t.width_m / 2 + site.size * between(-0.015, 0.015);
  lump.y_m = site.size * between(0.012, 0.024), lump.diameter_m = site.size * between(0.008, 0.016);
  lump.contrast = between(2, 6), lump.sphere = between(0, 1) < 0.5;
  t.inclusions = {lump};
  t.probe.force_gain_error = between(-0.03, 0.03);
  t.solid = solid;
  return t;
}

WarnedWindow pressed(const Site& site, const Tissue& t) {
  const service::ImageGrid& image = site.image;
  const double left_m = (t.width_m - t.probe.width_m) / 2;
  const client::ProbeState probe = client::press_solid(t, left_m, site.push_m(), site.spacing_m);
  std::mt19937_64 random(t.seed * 104729 + 5);
  WarnedWindow w;
  w.displacement.image = image, w.width_m = site.width_m();
  for (std::size_t n = 0; n < image.size(); ++n) {
    const double x = left_m + image.x_m(n), y = image.y_m(n);
    const auto u = probe.field->at(x, y), moved = probe.motion(x, y);
    w.displacement.axial_m.push_back(u.y - moved.y), w.displacement.lateral_m.push_back(u.x - moved.x);
  }
  w.displacement.noise_m = std::uniform_real_distribution<double>(0.3e-6, 1e-6)(random);
  w.tissue = {t.width_m, t.imaged_depth_m(), left_m, 0.49, service::Plane::kSolid};
  w.tissue.probe_elevation_m = site.elevation_m;
  // A user states the probe's face, whether all of it touches or not.
  w.force = service::ProbeForce{client::sensed_force(t.probe, probe.force_n, t.seed),
                                site.width_m() * site.elevation_m};
  return w;
}

// `share` of the axial strain more to the sides.
void spread(WarnedWindow& w, double share) {
  const std::vector<double>& u = w.displacement.axial_m;
  const service::ImageGrid& image = w.displacement.image;
  const std::size_t nx = image.nx;
  for (std::size_t j = 0; j < image.ny; ++j) {
    const std::size_t row = nx * std::min(j, image.ny - 2);
    double moved = 0;
    for (std::size_t i = 0; i < nx; ++i) {
      moved -= share * (u[row + nx + i] - u[row + i]) / image.dy_m * image.dx_m;
      w.displacement.lateral_m[i + nx * j] += moved;
    }
  }
}

// Nothing is trusted in this part of the columns.
void lose(WarnedWindow& w, double part) {
  const service::ImageGrid& image = w.displacement.image;
  w.displacement.trusted.assign(image.size(), 1);
  for (std::size_t n = 0; n < image.size(); ++n)
    if (static_cast<double>(n % image.nx) < part * static_cast<double>(image.nx))
      w.displacement.trusted[n] = 0;
}

service::KnownModulus told(const Tissue& t, double times) {
  struct Truth {  // which refers to its tissue
    explicit Truth(const Tissue& of) : tissue(of), modulus(tissue) {}
    Tissue tissue;
    client::TrueModulus modulus;
  };
  const auto truth = std::make_shared<const Truth>(t);
  return {[truth, times](double x, double y) { return times * truth->modulus(x, y); },
          [](double, double) { return 0.1; }};
}

WarnedWindow of_plane(const DrawnCase& drawn, std::uint64_t seed, ModulusKind kind,
                      const service::Queue& queue) {
  WarnedWindow w;
  const auto window = std::make_shared<DrawnWindow>(drawn, seed, queue);
  w.plane = window, w.width_m = DrawnWindow::kWindowM;
  w.tissue = window->input().tissue, w.force = window->input().force, w.kind = kind;
  return w;
}

}  // namespace

std::vector<WarningRow> warning_rows(const service::Queue& queue) {
  // Each tissue is pressed once for all windows that need it.
  const auto at = [](const Site& site, auto change) {
    const auto kept = std::make_shared<std::map<std::uint64_t, WarnedWindow>>();
    return [site, kept, change](std::uint64_t seed) {
      const std::uint64_t number = tissue_of(seed);
      if (const auto found = kept->find(number); found != kept->end()) return found->second;
      Tissue t = plain(site, number);
      change(t);
      return kept->emplace(number, pressed(site, t)).first->second;
    };
  };
  const auto of_tissue = [at](auto change) { return at(kSmall, change); };
  const auto usual = of_tissue([](Tissue&) {});
  std::vector<WarningRow> rows;
  const auto row = [&](const std::string& name, std::vector<Claim> claims, auto window) {
    rows.push_back({name, std::move(claims), window});
  };
  const auto changed = [usual](auto change) {
    return [usual, change](std::uint64_t seed) {
      WarnedWindow w = usual(seed);
      change(w);
      return w;
    };
  };
  // Of tissue that goes on with a lump of 4 to 8 mm, contrast 2 to 6, in whole contact.
  row("as assumed: friction to 0.3, uneven and texture to 10 %",
      {{WarningFlag::kNoise, false},
       {WarningFlag::kMisfit, false},
       {WarningFlag::kUntracked, false},
       {WarningFlag::kRamp, false},
       {WarningFlag::kOutOfPlane, false},
       {WarningFlag::kExtent, false},
       {WarningFlag::kDeadline, false},
       {WarningFlag::kCut, false},
       {WarningFlag::kModels, false},
       {WarningFlag::kElevation, false},
       {WarningFlag::kUnstated, false}},
      usual);
  row("noise of the displacement 8 um",
      {{WarningFlag::kNoise, true}, {WarningFlag::kMisfit, false}, {WarningFlag::kRamp, false}},
      changed([](WarnedWindow& w) { w.displacement.noise_m = 8e-6; }));
  row("bottom slides", {{WarningFlag::kMisfit, false}},
      of_tissue([](Tissue& t) { t.solid->support = Support::kSliding; }));
  row("bed of 5 mm, 2 kPa", {{WarningFlag::kMisfit, false}},
      of_tissue([](Tissue& t) { t.solid->support = Support::kBed, t.solid->bed_depth_m = 0.005; }));
  row("face touches in part, lean 1.5 mm",
      {{WarningFlag::kMisfit, true},
       {WarningFlag::kDeadline, true},
       {WarningFlag::kNoise, false},
       {WarningFlag::kModels, false}},
      of_tissue([](Tissue& t) { t.solid->lean_m = 0.0015; }));
  row("20 % of the image lost", {{WarningFlag::kUntracked, true}},
      changed([](WarnedWindow& w) { lose(w, 0.2); }));
  row("5 % of the image lost", {{WarningFlag::kUntracked, false}},
      changed([](WarnedWindow& w) { lose(w, 0.05); }));
  constexpr double kRamp = 2;
  const auto falls = [](Tissue& t) { t.solid->bottom_contrast = 1 / kRamp; };
  row(fmt::format("modulus falls by {} from top to bottom", kRamp),
      {{WarningFlag::kRamp, true},
       {WarningFlag::kExtent, false},
       {WarningFlag::kNoise, false},
       {WarningFlag::kModels, false}},
      of_tissue(falls));
  // Of a face that leans so much no other tissue is tried.
  row("a push that is uneven by 0.28, texture of 30 %",
      {{WarningFlag::kModels, true}, {WarningFlag::kMisfit, false}, {WarningFlag::kNoise, false}},
      of_tissue([](Tissue& t) { t.solid->uneven = 0.28, t.solid->texture = 0.3; }));
  row("face stated 1.75 times as long", {{WarningFlag::kElevation, true}},
      changed([](WarnedWindow& w) { w.tissue.probe_elevation_m *= 1.75, w.force->contact_area_m2 *= 1.75; }));
  // How deep the strain reaches tells the face's length where that is short: of 10 mm on 20 mm of tissue the
  // strain tells little, and little hangs on it.
  const auto short_face = at(kShortFace, [](Tissue&) {});
  row("face of 7 mm stated truly", {{WarningFlag::kElevation, false}}, short_face);
  row("face of 7 mm stated 1.75 times as long", {{WarningFlag::kElevation, true}},
      [short_face](std::uint64_t seed) {
        WarnedWindow w = short_face(seed);
        w.tissue.probe_elevation_m *= 1.75, w.force->contact_area_m2 *= 1.75;
        return w;
      });
  row("spreads sideways by 0.4 of the strain more", {{WarningFlag::kOutOfPlane, true}},
      changed([](WarnedWindow& w) { spread(w, 0.4); }));
  row("lump of 15 mm, contrast 3", {{WarningFlag::kExtent, true}}, of_tissue([](Tissue& t) {
        t.inclusions.front().x_m = t.width_m / 2, t.inclusions.front().y_m = 0.009;
        t.inclusions.front().diameter_m = 0.015, t.inclusions.front().contrast = 3;
      }));
  // Of a lump of 15 mm in a window of half the size hardly any contrast is left that could show.
  row("60 x 40 mm, lump of 30 mm, contrast 3", {{WarningFlag::kExtent, true}}, at(kLarge, [](Tissue& t) {
        t.inclusions.front().x_m = t.width_m / 2, t.inclusions.front().y_m = 0.018;
        t.inclusions.front().diameter_m = 0.030, t.inclusions.front().contrast = 3;
      }));
  row(fmt::format("60 x 40 mm, modulus falls by {} from top to bottom", kRamp),
      {{WarningFlag::kExtent, false}}, at(kLarge, falls));
  const auto beside = [usual](double times) {
    return [usual, times](std::uint64_t seed) {
      WarnedWindow w = usual(seed);
      w.known = told(plain(kSmall, tissue_of(seed)), times);
      return w;
    };
  };
  row("force twice what neighbours say", {{WarningFlag::kScale, true}}, beside(0.5));
  row("gain within 3 % beside neighbours", {{WarningFlag::kScale, false}}, beside(1));
  row("no time", {{WarningFlag::kCut, true}, {WarningFlag::kDeadline, false}},
      changed([](WarnedWindow& w) { w.budget.solves = 0; }));
  row("neither face nor depth stated, no time to fit them",
      {{WarningFlag::kUnstated, true}, {WarningFlag::kNoise, false}, {WarningFlag::kModels, false}},
      changed([](WarnedWindow& w) {
        w.tissue.probe_elevation_m = 0, w.tissue.depth_stated = false, w.force.reset();
        w.budget.solves = 0, w.background_pa = 1;
      }));
  std::ranges::move(frame_rows(), std::back_inserter(rows));
  const DrawnCase deep{}, shallow{.contrast = 3,
                                  .diameter_m = 0.003,
                                  .strain = 0.01,
                                  .noise_m = 0.1e-6,
                                  .texture = true,
                                  .depth_m = 0.010};
  for (const auto& [drawn, provoked] : {std::pair(shallow, true), std::pair(deep, false)})
    row(fmt::format("plane strain, {:.0f} mm deep, nu 0.4999", 1e3 * drawn.depth_m),
        {{WarningFlag::kPressure, provoked}}, [queue, drawn](std::uint64_t seed) {
          WarnedWindow w = of_plane(drawn, seed, ModulusKind::kIterative, queue);
          w.tissue.poisson_ratio = 0.4999;
          return w;
        });
  row("direct, plane strain, strain 0.3 %, noise 6 um", {{WarningFlag::kStreaks, true}},
      [queue](std::uint64_t seed) {
        DrawnCase drawn;
        drawn.strain = 0.003, drawn.noise_m = 6e-6;
        return of_plane(drawn, seed, ModulusKind::kDirect, queue);
      });
  row("direct, plane strain, strain 1 %, noise 0.5 um", {{WarningFlag::kStreaks, false}},
      [queue](std::uint64_t seed) { return of_plane({}, seed, ModulusKind::kDirect, queue); });
  return rows;
}

}  // namespace teletact::bench
