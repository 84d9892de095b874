// The product as the recorder sees it: plain numbers in, named numbers out. When names and signatures of the
// product change, product.cpp changes with them; what is recorded does not.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace teletact::vectors {

struct Named {
  const char* name;
  std::vector<double> values;
  bool exact = false;  // counts, states and flags: another machine has the same
};
using Answer = std::vector<Named>;

using Modulus = std::function<double(double x_m, double y_m)>;  // Pa

// ---- imaging

struct PatientCase {
  std::string name, tissue;  // a tissue file's text
  double window_m = 0;       // left end of the probe
  bool lab_frame = false;
  bool sensed = true;       // the probe's force; without it the modulus is relative
  bool neighbours = false;  // have told the modulus beside the window
};

// Presses the probe, once, and estimates by each method: "tracking" and then the methods' names, with maps
// (a number for each node) and what is said of them. No time limit decides.
struct Estimated {
  std::string by;
  Answer maps;
};
std::vector<Estimated> estimate(const PatientCase&);

// ---- touch

struct TissueCase {
  double width_m = 0.1, depth_m = 0.04, poisson_ratio = 0.49;
  bool top = false, bottom = true, left = false, right = false;  // held
  Modulus modulus_pa;
  double window_width_m = 0;         // 0: the modulus is given explicitly, 1 mm squares
  std::vector<double> windows = {};  // left ends of what is published at first
};

enum class Tip { kRounded, kPunch, kNode };
struct Finger {
  Tip tip = Tip::kRounded;
  bool stuck = false;
  double size_m = 0.008;  // radius; half of the punch's flat part; deviation of the node's footprint
  double layer_m = 0;     // depth of the touched layer
};

class Touching {
 public:
  Touching(const TissueCase&, const Finger&);
  ~Touching();
  double layer_m() const;  // the one that is nearest
  void publish(double window_m, const Modulus& modulus_pa);
  Answer touch(double x_m, double y_m);
  // By conjugate gradients on the device, however long that takes, on the first window; pressed.
  Answer touch_iteratively(double x_m, double indentation_m);

 private:
  struct Product;
  std::unique_ptr<Product> product_;
};

// ---- servo

struct ForceAnswer {
  std::uint64_t sequence = 0;
  double pose_time_s = 0, x_m = 0, y_m = 0;  // of the pose that was touched
  std::array<double, 2> force_n{};
  std::array<double, 4> tangent_n_m{};
  bool contact = false, foreseen = false, has_force = true, degraded = false;
};

struct TickCase {
  std::int64_t time_ns = 0;
  double x_m = 0, y_m = 0, velocity_x_m_s = 0, velocity_y_m_s = 0;
  bool device_answers = true, resume = false, pause = false;
  std::optional<ForceAnswer> answer;  // that came in since the last tick
};

class Servo {  // with the Kalman filter
 public:
  Servo();
  ~Servo();
  Answer tick(const TickCase&);

 private:
  struct Product;
  std::unique_ptr<Product> product_;
};

}  // namespace teletact::vectors
