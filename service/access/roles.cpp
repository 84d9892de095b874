#include "service/access/roles.h"

namespace teletact::service {

bool allows(Role role, Need need) {
  switch (need) {
    case Need::kKnown:
    case Need::kRead:
      return true;
    case Need::kFeel:
      return role != Role::kPatient;
    case Need::kSteer:
      return role == Role::kOperator || role == Role::kAdministrator;
    case Need::kPublish:
    case Need::kFollow:
      return role == Role::kPatient || role == Role::kAdministrator;
    case Need::kDelete:
      return role == Role::kAdministrator;
  }
  return false;
}

const char* name_of(Role role) {
  switch (role) {
    case Role::kPatient:
      return "patient";
    case Role::kOperator:
      return "operator";
    case Role::kObserver:
      return "observer";
    case Role::kAdministrator:
      return "administrator";
  }
  return "none";
}

std::optional<Role> role_of(std::string_view name) {
  for (const Role role : kRoles)
    if (name == name_of(role)) return role;
  return std::nullopt;
}

const char* words_of(Need need) {
  switch (need) {
    case Need::kKnown:
      return "ask about";
    case Need::kRead:
      return "read";
    case Need::kFeel:
      return "touch";
    case Need::kSteer:
      return "steer a touch of";
    case Need::kPublish:
      return "publish into";
    case Need::kFollow:
      return "follow the finger of";
    case Need::kDelete:
      return "delete";
  }
  return "use";
}

std::string roles_for(Need need) {
  std::string names;
  for (const Role role : kRoles)
    if (allows(role, need)) names += (names.empty() ? "" : " or ") + std::string(name_of(role));
  return names;
}

}  // namespace teletact::service
