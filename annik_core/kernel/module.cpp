// The Python module annik_core.kernel.compiled.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <atomic>
#include <cstdlib>
#include <new>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>

#include "refinement.hpp"

namespace py = pybind11;

namespace annik {
namespace {

// Converted where it must be: another type, order of bytes, layout or alignment.
using Array = py::array_t<double, py::array::c_style | py::array::forcecast |
                                      py::detail::npy_api::NPY_ARRAY_ALIGNED_>;

void check_shape(const Array& array, std::initializer_list<py::ssize_t> shape, const char* name) {
  bool fits = array.ndim() == static_cast<py::ssize_t>(shape.size());
  std::string text;
  py::ssize_t axis = 0;
  for (const py::ssize_t wanted : shape) {
    fits = fits && array.shape(axis) == wanted;
    text += (axis++ ? ", " : "") + std::to_string(wanted);
  }
  if (!fits) throw std::invalid_argument(std::string(name) + " must have the shape (" + text + ")");
}

Placement placement_of(const double* pose) {
  return {rotation_of(pose + 3), {pose[0], pose[1], pose[2]}};
}

void write_pose(const Placement& placement, double* pose) {
  const auto quaternion = quaternion_of(placement.rotation);
  std::copy(placement.position.begin(), placement.position.end(), pose);
  std::copy(quaternion.begin(), quaternion.end(), pose + 3);
}

Joints joints_from(const double* numbers, py::ssize_t count) {
  Joints joints{};
  std::copy_n(numbers, count, joints.begin());
  return joints;
}

// Row by row.
void write_jacobian(const Jacobian& jacobian, py::ssize_t dof, double* numbers) {
  for (std::size_t row = 0; row < 6; ++row)
    for (py::ssize_t joint = 0; joint < dof; ++joint) *numbers++ = jacobian[joint][row];
}

// The rotation from the z axis to a unit vector, by the shortest way.
Rotation z_towards(const Vector3& axis) {
  if (axis[2] < -1.0 + 1e-9 && std::hypot(axis[0], axis[1]) < 1e-9)
    return {{1.0, 0.0, 0.0}, {0.0, -1.0, 0.0}, {0.0, 0.0, -1.0}};
  const Vector3 about = cross({0.0, 0.0, 1.0}, axis);
  const double sine = norm(about);
  const double angle = std::atan2(sine, axis[2]);
  return rotation_about((sine > 0.0 ? angle / sine : 0.0) * about);
}

// Runs ``work(row)`` for all rows, in blocks, on several threads.
template <typename Work>
void for_rows(std::size_t rows, int threads, const Work& work) {
  constexpr std::size_t BLOCK = 16;
  std::atomic<std::size_t> next{0};
  const auto run = [&] {
    while (true) {
      const std::size_t begin = next.fetch_add(BLOCK);
      if (begin >= rows) return;
      for (std::size_t row = begin; row < std::min(rows, begin + BLOCK); ++row) work(row);
    }
  };
  const std::size_t most = std::min<std::size_t>(threads, (rows + BLOCK - 1) / BLOCK);
  std::vector<std::thread> others;
  try {
    for (std::size_t thread = 1; thread < most; ++thread) others.emplace_back(run);
  } catch (const std::system_error&) {  // no more threads are to be had: these do it too
  }
  run();
  for (std::thread& thread : others) thread.join();
}

// Of an object of Python. ``__new__`` alone gives one memory without calling its constructor: that
// memory is zero, so that such an object has no joints.
struct Object {
  static void* operator new(std::size_t size) {
    if (void* memory = std::calloc(1, size)) return memory;
    throw std::bad_alloc();
  }
  static void operator delete(void* memory) { std::free(memory); }

  static py::ssize_t constructed(py::ssize_t dof) {
    if (dof == 0) throw py::type_error("it was made without its constructor");
    return dof;
  }
};

}  // namespace

// A chain as Python sees it. It never changes, so threads may share it.
class PyChain : public Object {
 public:
  // ``joint_networks`` and ``pose_network``: None, or of the classes in robots/corrections.py.
  PyChain(const Array& placements, const Array& axes, const py::object& joint_networks,
          const py::object& pose_network, const std::vector<std::size_t>& wrapped,
          const Array& centre) {
    const py::ssize_t dof = axes.ndim() == 2 ? axes.shape(0) : 0;
    if (dof < 1 || dof > static_cast<py::ssize_t>(MAX_JOINTS))
      throw std::invalid_argument("axes must have 1 to 32 rows, one a joint");
    check_shape(axes, {dof, 6}, "axes");
    check_shape(placements, {dof + 1, 4, 4}, "placements");
    // From the frame whose z axis is that of the joint before, to that joint's own.
    Placement back;
    for (py::ssize_t joint = 0; joint <= dof; ++joint) {
      const double* m = placements.data(joint);
      const Placement placement =
          back * Placement{{{m[0], m[4], m[8]}, {m[1], m[5], m[9]}, {m[2], m[6], m[10]}},
                           {m[3], m[7], m[11]}};
      if (joint == dof) {
        chain_.end_effector = placement;
        break;
      }
      const double* a = axes.data(joint);
      const bool turns = a[3] != 0.0 || a[4] != 0.0 || a[5] != 0.0;
      const Rotation axis = z_towards(turns ? Vector3{a[3], a[4], a[5]}
                                            : Vector3{a[0], a[1], a[2]});
      back = Placement{axis.inverse(), {0.0, 0.0, 0.0}};
      chain_.joints.push_back({{placement.rotation * axis, placement.position}, turns});
    }
    if (!joint_networks.is_none()) set_joint_networks(joint_networks);
    if (!pose_network.is_none()) set_pose_network(pose_network);
    if (wrapped.empty()) return;
    check_shape(centre, {dof}, "centre");
    for (const std::size_t joint : wrapped)
      if (joint >= chain_.size()) throw std::invalid_argument("no such joint");
    chain_.wrapped = wrapped;
    chain_.wrap_centre = joints_from(centre.data(), dof);
  }

  Array poses(const Array& joint_positions) const {
    const py::ssize_t rows = joint_positions.ndim() ? joint_positions.shape(0) : 0;
    check_shape(joint_positions, {rows, dof()}, "joint_positions");
    Array result({rows, py::ssize_t{7}});
    const double* from = joint_positions.data();
    double* to = result.mutable_data();
    py::gil_scoped_release release;
    for (py::ssize_t row = 0; row < rows; ++row, from += dof(), to += 7)
      write_pose(chain_.pose(joints_from(from, dof())), to);
    return result;
  }

  Array jacobians(const Array& joint_positions) const {
    const py::ssize_t rows = joint_positions.ndim() ? joint_positions.shape(0) : 0;
    check_shape(joint_positions, {rows, dof()}, "joint_positions");
    Array result({rows, py::ssize_t{6}, dof()});
    const double* from = joint_positions.data();
    double* to = result.mutable_data();
    py::gil_scoped_release release;
    Jacobian jacobian;
    for (py::ssize_t row = 0; row < rows; ++row, from += dof(), to += 6 * dof()) {
      chain_.jacobian(joints_from(from, dof()), jacobian);
      write_jacobian(jacobian, dof(), to);
    }
    return result;
  }

  py::tuple linearise(const Array& joint_positions, const Array& target) const {
    check_shape(joint_positions, {dof()}, "joint_positions");
    check_shape(target, {7}, "target");
    Linearisation linear;
    chain_.linearise(joints_from(joint_positions.data(), dof()), placement_of(target.data()),
                     linear);
    Array twist(6), jacobian({py::ssize_t{6}, dof()}), displacement(3);
    std::copy_n(linear.twist.begin(), 6, twist.mutable_data());
    write_jacobian(linear.jacobian, dof(), jacobian.mutable_data());
    std::copy_n(linear.displacement.begin(), 3, displacement.mutable_data());
    return py::make_tuple(twist, jacobian, displacement);
  }

  py::tuple residuals(const Array& joint_positions, const Array& target) const {
    check_shape(joint_positions, {dof()}, "joint_positions");
    check_shape(target, {7}, "target");
    Linearisation linear;
    chain_.linearise(joints_from(joint_positions.data(), dof()), placement_of(target.data()),
                     linear);
    return py::make_tuple(linear.position_residual(), linear.orientation_residual());
  }

  const Chain& chain() const {
    dof();
    return chain_;
  }

 private:
  py::ssize_t dof() const { return constructed(static_cast<py::ssize_t>(chain_.size())); }

  void set_joint_networks(const py::object& part) {
    const Array input = array_of(part, "input_weights"), bias = array_of(part, "biases");
    const Array output = array_of(part, "output_weights");
    const py::ssize_t hidden = input.ndim() == 2 ? input.shape(1) : 0;
    check_shape(input, {dof(), hidden}, "input_weights");
    check_shape(bias, {dof(), hidden}, "biases");
    check_shape(output, {dof(), hidden}, "output_weights");
    chain_.joint_scaling = scaling_of(part);
    chain_.joint_networks = JointNetworks{static_cast<std::size_t>(hidden), numbers(input),
                                          numbers(bias), numbers(output)};
  }

  void set_pose_network(const py::object& part) {
    const Array input = array_of(part, "input_weights"), bias = array_of(part, "biases");
    const Array output = array_of(part, "output_weights");
    const py::ssize_t hidden = bias.ndim() == 1 ? bias.shape(0) : 0;
    check_shape(input, {hidden, dof()}, "input_weights");
    check_shape(bias, {hidden}, "biases");
    check_shape(output, {6, hidden}, "output_weights");
    chain_.pose_scaling = scaling_of(part);
    PoseNetwork network{static_cast<std::size_t>(hidden), numbers(input), numbers(bias), {}};
    for (py::ssize_t unit = 0; unit < hidden; ++unit)
      for (py::ssize_t row = 0; row < 6; ++row) network.output.push_back(*output.data(row, unit));
    chain_.pose_network = std::move(network);
  }

  static Array array_of(const py::object& part, const char* name) {
    return part.attr(name).cast<Array>();
  }

  Scaling scaling_of(const py::object& part) const {
    const Array centre = array_of(part, "centre"), half_width = array_of(part, "half_width");
    check_shape(centre, {dof()}, "centre");
    check_shape(half_width, {dof()}, "half_width");
    return {joints_from(centre.data(), dof()), joints_from(half_width.data(), dof())};
  }

  static std::vector<double> numbers(const Array& array) {
    return {array.data(), array.data() + array.size()};
  }

  Chain chain_;
};

class PyRefinement : public Object {
 public:
  PyRefinement(const PyChain& chain, const Array& lower, const Array& upper, int max_newton_steps,
               double tolerance)
      : dof_(static_cast<py::ssize_t>(chain.chain().size())) {
    check_shape(lower, {dof_}, "lower");
    check_shape(upper, {dof_}, "upper");
    refinement_.chain = chain.chain();
    refinement_.lower = joints_from(lower.data(), dof_);
    refinement_.upper = joints_from(upper.data(), dof_);
    for (py::ssize_t joint = 0; joint < dof_; ++joint)
      if (lower.data()[joint] < upper.data()[joint]) refinement_.free.push_back(joint);
    if (refinement_.free.empty()) throw std::invalid_argument("no joint moves");
    refinement_.max_newton_steps = max_newton_steps;
    refinement_.tolerance = tolerance;
  }

  py::tuple refine(const Array& start, const Array& target) const {
    check_shape(start, {dof()}, "start");
    check_shape(target, {7}, "target");
    const Refined found =
        refinement_.refine(joints_from(start.data(), dof_), placement_of(target.data()));
    Array positions(dof_);
    std::copy_n(found.joint_positions.begin(), dof_, positions.mutable_data());
    return py::make_tuple(std::move(positions), found.position_residual,
                          found.orientation_residual, found.newton_steps, found.converged);
  }

  py::tuple refine_batch(const Array& starts, const Array& targets, int threads) const {
    const py::ssize_t rows = starts.ndim() ? starts.shape(0) : 0;
    check_shape(starts, {rows, dof()}, "starts");
    check_shape(targets, {rows, 7}, "targets");
    if (threads < 1) throw std::invalid_argument("threads must be at least 1");
    Array positions({rows, dof_}), distances(rows), angles(rows);
    py::array_t<int> steps(rows);
    py::array_t<bool> converged(rows);
    const double *from = starts.data(), *to = targets.data();
    double* found = positions.mutable_data();
    double *distance = distances.mutable_data(), *angle = angles.mutable_data();
    int* taken = steps.mutable_data();
    bool* ended = converged.mutable_data();
    {
      py::gil_scoped_release release;
      for_rows(rows, threads, [&](std::size_t row) {
        const Refined result =
            refinement_.refine(joints_from(from + row * dof_, dof_), placement_of(to + 7 * row));
        std::copy_n(result.joint_positions.begin(), dof_, found + row * dof_);
        distance[row] = result.position_residual;
        angle[row] = result.orientation_residual;
        taken[row] = result.newton_steps;
        ended[row] = result.converged;
      });
    }
    return py::make_tuple(positions, distances, angles, steps, converged);
  }

 private:
  py::ssize_t dof() const { return constructed(dof_); }

  py::ssize_t dof_;
  Refinement refinement_;
};

}  // namespace annik

PYBIND11_MODULE(compiled, module) {
  using namespace annik;
  module.doc() = "Forward kinematics and refinement of serial chains, compiled.";
  py::class_<PyChain>(module, "Chain")
      .def(py::init<const Array&, const Array&, const py::object&, const py::object&,
                    const std::vector<std::size_t>&, const Array&>())
      .def("poses", &PyChain::poses)
      .def("jacobians", &PyChain::jacobians)
      .def("linearise", &PyChain::linearise)
      .def("residuals", &PyChain::residuals);
  py::class_<PyRefinement>(module, "Refinement")
      .def(py::init<const PyChain&, const Array&, const Array&, int, double>())
      .def("refine", &PyRefinement::refine)
      .def("refine_batch", &PyRefinement::refine_batch);
}
