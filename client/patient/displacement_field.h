// How tissue has moved, wherever one asks.
#pragma once

namespace teletact::client {

class DisplacementField {
 public:
  struct Vector {
    double x = 0, y = 0, z = 0;
  };
  virtual ~DisplacementField() = default;
  // Displacement (m) in the LAB frame (the bottom rests). Points outside the tissue move with its nearest
  // point.
  virtual Vector at(double x_m, double y_m, double z_m) const = 0;
  Vector at(double x_m, double y_m) const { return at(x_m, y_m, 0); }  // in the image plane
};

}  // namespace teletact::client
