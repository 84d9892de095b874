// Vectors of a touch, the surface that is touched, and the frame in which a renderer keeps its model of it.
#pragma once

#include <Eigen/Core>

namespace teletact::client {

using Vector2 = Eigen::Vector2d;
using Vector3 = Eigen::Vector3d;  // [x lateral, y into the tissue, z elevational], scene coordinates
using Matrix3 = Eigen::Matrix3d;

// The undeformed surface or interior layer under the finger, as a plane: normal . position = offset.
struct TouchedSurface {
  Vector3 normal = Vector3::UnitY();  // of length 1, into the tissue
  double offset_m = 0;
  // How far a place lies in the tissue: the indentation of a finger there.
  double depth_m(const Vector3& position_m) const noexcept { return normal.dot(position_m) - offset_m; }
};

// Axes of a contact: lateral, along the push (the surface's normal), second lateral; in this order the
// scene's x, y and z, turned by the least rotation that takes y to the normal. On a surface y = constant, so
// in every plane scene, they are the scene's own, to the bit.
class ContactFrame {
 public:
  ContactFrame() = default;
  explicit ContactFrame(const Vector3& normal) noexcept {
    constexpr double kOpposite = 1e-9;  // tissue above the finger: which rotation is least is not said
    const double a = normal.x(), b = normal.y(), c = normal.z(), turn = 1 / (1 + b);
    axes_.col(1) = normal;
    if (1 + b > kOpposite) {
      axes_.col(0) = Vector3(1 - a * a * turn, -a, -a * c * turn);
      axes_.col(2) = Vector3(-a * c * turn, -c, 1 - c * c * turn);
    } else {
      axes_.col(0) = Vector3::UnitX();
      axes_.col(2) = -Vector3::UnitZ();
    }
  }
  Vector3 to_contact(const Vector3& scene) const noexcept { return axes_.transpose() * scene; }
  Matrix3 tensor_to_contact(const Matrix3& scene) const noexcept { return axes_.transpose() * scene * axes_; }
  Vector3 to_scene(const Vector3& contact) const noexcept { return axes_ * contact; }

 private:
  Matrix3 axes_ = Matrix3::Identity();  // columns: of the contact, in the scene
};

// The lateral components of what is given in a contact's axes.
inline Vector2 lateral(const Vector3& contact) noexcept {
  return {contact.x(), contact.z()};
}

}  // namespace teletact::client
