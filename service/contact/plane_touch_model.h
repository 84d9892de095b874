// The plane-strain model (T4) as what is touched: its rows of nodes are the layers, on each the contact of a
// fingertip is solved over the row's compliance. Force and tangent along z are zero.
#pragma once

#include <memory>

#include "service/contact/plane_budget.h"
#include "service/contact/touch_model.h"
#include "service/tissue/tissue_model.h"

namespace teletact::service {

class PlaneTouchModel final : public TouchModel {
 public:
  explicit PlaneTouchModel(std::shared_ptr<const TissueModel>, MemoryAccount = {});
  Region region() const override;
  std::vector<Layer> layers() const override;
  std::string plan() const override;
  // kCompliance: condensed; kGradients: by conjugate gradients on the way's device. kAuto: condensed.
  std::shared_ptr<TouchedLayer> layer(const Layer&, const TouchWay&, const TouchWork&) const override;

 private:
  class PreparedCompliances;
  const std::shared_ptr<const TissueModel> tissue_;
  const std::shared_ptr<const PlaneBudget> budget_;
  const std::shared_ptr<PreparedCompliances> compliances_;
};

// The rows that no support holds, of those at `y_m`.
std::vector<Layer> free_layers(const std::vector<double>& y_m, const Supports&);

}  // namespace teletact::service
