// Shares that the elements of layered tissue have in the work of a contact about node 0, and what a map over
// the elements is in the mean, with these shares, about each node of the surface: correlations, by Fourier
// transforms.
#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "service/device/device.h"
#include "service/solver/fourier.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

// z . K_e u of each element, [layer][z][x]; u and z: fields, [plane = 3 row + component][z][x]. `mirrored`:
// tissue and fields are alike on both sides of node 0, along x and along z; a quarter is then looked at.
template <class T>
std::vector<double> work_of_elements(const SolidTissue&, const std::vector<T>& u, const std::vector<T>& z,
                                     bool mirrored = false);

// One thread at a time, as its queue.
class ElementMeans {
 public:
  // The transform of a map over the elements.
  using Map = std::vector<float>;
  // at_once: so many means at most.
  ElementMeans(const Queue&, const SolidGrid&, std::size_t at_once = 1);
  Map transformed(const std::vector<float>& of_elements);
  // Of the elements' shares in z . K u, 1 in all; tissue and fields mirrored, as above.
  template <class T>
  Map shares(const SolidTissue& layers, const std::vector<T>& u, const std::vector<T>& z);
  // About each node of the surface, [z][x]: sum over e of share_e map_(e + node).
  Eigen::VectorXd means(const Map& shares, const Map& map);
  // Of each pair of shares and a map, at once.
  std::vector<Eigen::VectorXd> means(const std::vector<std::pair<const Map*, const Map*>>&);

 private:
  Queue queue_;
  std::size_t layers_;
  Fourier<float> elements_, surface_;
  Array<float> field_, spectrum_, plane_, sum_;
};

}  // namespace teletact::service
