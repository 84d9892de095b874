#include "bench/own_scene.h"

#include <fmt/format.h>
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <cmath>

#include "bench/suite.h"
#include "bench/touch_client.h"
#include "client/link/channel.h"

namespace teletact::bench {
namespace {

constexpr double kForceTolerance = 2e-3;  // plain float's promise against the reference

}  // namespace

reference::TouchedTissue own_tissue() {
  reference::TouchedTissue tissue;
  constexpr int kColumns = 60, kRows = 20;
  for (int i = 0; i <= kColumns; ++i) tissue.grid.x_m.push_back(0.12 * i / kColumns);
  for (int j = 0; j <= kRows; ++j) tissue.grid.y_m.push_back(0.04 * j / kRows);
  tissue.material.youngs_modulus_pa.assign(tissue.grid.elements(), 10e3);
  for (std::size_t j = 3; j < 8; ++j)
    for (std::size_t i = 27; i < 32; ++i) tissue.material.youngs_modulus_pa[tissue.grid.element(i, j)] = 40e3;
  return tissue;
}

void remove_scene(v1::Palpation::Stub& stub, const std::string& scene_id) {
  v1::DeleteSceneRequest request;
  request.set_scene_id(scene_id);
  v1::DeleteSceneResponse deleted;
  grpc::ClientContext context;
  stub.DeleteScene(&context, request, &deleted);  // NOT_FOUND is fine
}

void create_scene(v1::Palpation::Stub& stub, const v1::CreateSceneRequest& request) {
  remove_scene(stub, request.scene_id());
  v1::Scene scene;
  grpc::ClientContext context;
  const grpc::Status status = stub.CreateScene(&context, request, &scene);
  if (!status.ok()) throw BenchError("CreateScene: " + client::describe(status));
}

void create_own_scene(v1::Palpation::Stub& stub, const std::string& scene_id,
                      const reference::TouchedTissue& tissue) {
  v1::CreateSceneRequest request;
  request.set_scene_id(scene_id);
  v1::SceneGeometry& geometry = *request.mutable_geometry();
  geometry.add_size_m(tissue.grid.x_m.back());
  geometry.add_size_m(tissue.grid.y_m.back());
  geometry.set_poisson_ratio(tissue.material.poisson_ratio);
  geometry.set_thickness_m(tissue.thickness_m);
  v1::ModulusMap& map = *request.mutable_modulus();
  map.mutable_x_m()->Add(tissue.grid.x_m.begin(), tissue.grid.x_m.end());
  map.mutable_y_m()->Add(tissue.grid.y_m.begin(), tissue.grid.y_m.end());
  v1::Array& array = *map.mutable_youngs_modulus_pa();
  array.set_dtype(v1::DATA_TYPE_FLOAT64);
  array.add_shape(static_cast<std::uint32_t>(tissue.grid.ny() - 1));
  array.add_shape(static_cast<std::uint32_t>(tissue.grid.nx() - 1));
  const auto& pa = tissue.material.youngs_modulus_pa;
  array.set_data(std::string(reinterpret_cast<const char*>(pa.data()), pa.size() * sizeof(double)));
  create_scene(stub, request);
}

double largest_error(const char* of, double tolerance, const std::vector<double>& shares,
                     const std::function<double(double share)>& error_at) {
  double largest = 0;
  for (const double share : shares) {
    const double error = error_at(share);
    if (!(error <= tolerance))
      throw BenchError(
          fmt::format("the force at {:.0f} % of the tissue is off by {:.3g} of {}: not worth timing",
                      100 * share, error, of));
    largest = std::max(largest, error);
  }
  return largest;
}

double check_against_reference(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id,
                               const reference::TouchedTissue& tissue, double indentation_m) {
  return largest_error("the reference", kForceTolerance, {0.2592, 0.4892, 0.6367}, [&](double share) {
    const double x_m = share * tissue.grid.x_m.back();
    const auto f =
        reference::touch(tissue, {}, {x_m, indentation_m}, reference::KktMethod::kSparseFactor).force_n;
    const v1::TouchAnswer answer = touch_once(channel, scene_id, x_m, indentation_m);
    return std::hypot(answer.force_n(0) - f[0], answer.force_n(1) - f[1]) / std::hypot(f[0], f[1]);
  });
}

Checked make_checked_scene(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id,
                           const reference::TouchedTissue& tissue, double indentation_m) {
  create_own_scene(*v1::Palpation::NewStub(channel), scene_id, tissue);
  return {"dense reference", check_against_reference(channel, scene_id, tissue, indentation_m)};
}

}  // namespace teletact::bench
