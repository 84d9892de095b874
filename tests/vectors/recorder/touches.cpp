#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tests/vectors/recorder/product.h"
#include "tests/vectors/recorder/record.h"

namespace teletact::vectors {
namespace {

constexpr int kTouches = 1000;  // on each tissue

Modulus homogeneous(double modulus_pa) {
  return [=](double, double) { return modulus_pa; };
}

Modulus inclusion(double contrast, double at_x_m, double at_y_m, double radius_m) {
  return [=](double x_m, double y_m) {
    const double dx = x_m - at_x_m, dy = y_m - at_y_m;
    return dx * dx + dy * dy < radius_m * radius_m ? contrast * 10e3 : 10e3;
  };
}

double layers(double, double y_m) {
  return y_m < 0.004 ? 30e3 : y_m < 0.015 ? 6e3 : 15e3;
}

// What is published in the middle of the path.
struct Later {
  double window_m;
  Modulus modulus_pa;
};

struct Scene {
  std::string name;
  TissueCase tissue;
  Finger finger;
  std::vector<Later> later = {};
};

std::vector<Scene> scenes() {
  const Modulus across = inclusion(6, 0.062, 0.012, 0.007);
  std::vector<Scene> all{
      {"homogeneous", {.modulus_pa = homogeneous(10e3)}, {}},
      {"contrast-2", {.modulus_pa = inclusion(2, 0.05, 0.010, 0.006)}, {.stuck = true, .size_m = 0.006}},
      {"contrast-10", {.modulus_pa = inclusion(10, 0.045, 0.012, 0.008)}, {Tip::kPunch, false, 0.004}},
      {"contrast-100", {.modulus_pa = inclusion(100, 0.055, 0.015, 0.005)}, {Tip::kNode, true, 0}},
      {"layers", {.poisson_ratio = 0.45, .modulus_pa = layers}, {.layer_m = 0.010}},
      {"nearly-incompressible", {.poisson_ratio = 0.4999, .modulus_pa = homogeneous(8e3)}, {}},
      {"sides-held",
       {.poisson_ratio = 0.495, .left = true, .right = true, .modulus_pa = inclusion(5, 0.03, 0.01, 0.006)},
       {Tip::kPunch, true, 0.003}},
      {"top-held",
       {.top = true, .bottom = false, .modulus_pa = homogeneous(12e3)},
       {Tip::kNode, false, 0.0015, 0.015}},
      {"windows",
       {.width_m = 0.18, .modulus_pa = across, .window_width_m = 0.06, .windows = {0, 0.06}},
       {},
       {{0.12, across}, {0, homogeneous(14e3)}}},
      {"windows-inside",
       {.width_m = 0.15, .modulus_pa = across, .window_width_m = 0.06, .windows = {0, 0.045, 0.09}},
       {Tip::kPunch, false, 0.003, 0.006}}};
  return all;
}

// 0 .. 1 .. 0 in so many steps.
double to_and_fro(int step, int period) {
  return 1 - std::abs(2.0 * (step % period) / period - 1);
}

void append(Recording& recording, const std::string& of, const Answer& answer, const Tolerance& tolerance) {
  for (const Named& part : answer)
    recording.append("touch/" + of + "/" + part.name, part.values.size(), part.values,
                     part.exact ? kExact : tolerance);
}

void record(Recording& recording, const Scene& scene) {
  Touching touching(scene.tissue, scene.finger);
  const double width_m = scene.tissue.width_m;
  for (int k = 0; k < kTouches; ++k) {
    if (k == kTouches / 2)
      for (const Later& later : scene.later) touching.publish(later.window_m, later.modulus_pa);
    // From beside one end to beside the other, from 2 mm above the layer to 5 mm below.
    const double x_m = width_m * (-0.01 + 1.02 * to_and_fro(k, 691));
    const double depth_m = -0.002 + 0.007 * to_and_fro(k, 83);
    append(recording, scene.name, touching.touch(x_m, touching.layer_m() + depth_m), kTouch);
  }
}

}  // namespace

void record_touches(Recording& recording) {
  const std::vector<Scene> all = scenes();
  for (const Scene& scene : all) record(recording, scene);
  for (const std::size_t which : {1, 2}) {
    Touching touching(all[which].tissue, all[which].finger);
    for (int k = 0; k < 20; ++k)
      append(recording, all[which].name + "/iterative",
             touching.touch_iteratively(0.04 + 0.02 * to_and_fro(k, 20), 0.0005 + 0.004 * to_and_fro(k, 7)),
             kIterativeTouch);
  }
}

}  // namespace teletact::vectors
