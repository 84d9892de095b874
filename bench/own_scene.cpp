#include "bench/own_scene.h"

#include <fmt/format.h>
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <cmath>

#include "bench/suite.h"
#include "bench/touch_client.h"
#include "client/link/channel.h"
#include "client/link/scenes.h"

namespace teletact::bench {
namespace {

constexpr double kForceTolerance = 2e-3;  // plain float's promise against the reference

}  // namespace

reference::TouchedTissue own_tissue(double element_m) {
  constexpr double kWidthM = 0.12, kDepthM = 0.04;
  constexpr double kBlockBeginM = 0.054, kBlockEndM = 0.064, kBlockTopM = 0.006, kBlockBottomM = 0.016;
  reference::TouchedTissue tissue;
  const auto nodes = [element_m](double length_m) {
    const long count = std::lround(length_m / element_m);
    std::vector<double> at_m;
    for (long i = 0; i <= count; ++i)
      at_m.push_back(length_m * static_cast<double>(i) / static_cast<double>(count));
    return at_m;
  };
  tissue.grid.x_m = nodes(kWidthM);
  tissue.grid.y_m = nodes(kDepthM);
  for (std::size_t j = 0; j + 1 < tissue.grid.ny(); ++j)
    for (std::size_t i = 0; i + 1 < tissue.grid.nx(); ++i) {
      const double x_m = (tissue.grid.x_m[i] + tissue.grid.x_m[i + 1]) / 2;
      const double y_m = (tissue.grid.y_m[j] + tissue.grid.y_m[j + 1]) / 2;
      const bool stiff = x_m > kBlockBeginM && x_m < kBlockEndM && y_m > kBlockTopM && y_m < kBlockBottomM;
      tissue.material.youngs_modulus_pa.push_back(stiff ? 40e3 : 10e3);
    }
  return tissue;
}

void remove_scene(v1::Palpation::Stub& stub, const std::string& scene_id) {
  v1::DeleteSceneRequest request;
  request.set_scene_id(scene_id);
  v1::DeleteSceneResponse deleted;
  grpc::ClientContext context;
  client::name_scene(context, scene_id);
  stub.DeleteScene(&context, request, &deleted);  // NOT_FOUND is fine
}

void create_scene(v1::Palpation::Stub& stub, const v1::CreateSceneRequest& request) {
  remove_scene(stub, request.scene_id());
  v1::Scene scene;
  grpc::ClientContext context;
  client::name_scene(context, request.scene_id());
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
