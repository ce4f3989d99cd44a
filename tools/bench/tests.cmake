# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt.
set(_prints "${CMAKE_SOURCE_DIR}/tests/support/prints.sh")  # REGEX COMMAND...: both count
if(TARGET urgengo::cli)
  urgengo_add_tests(urgengo_call_bench_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_bench_calls.cpp"
    LINK urgengo::benches)
endif()
urgengo_add_tests(urgengo_thread_mix_tests LABEL unit
  SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_thread_mix_spec.cpp" "${CMAKE_CURRENT_LIST_DIR}/thread_mix_spec.cpp"
  LINK fmt::fmt-header-only nlohmann_json::nlohmann_json)

# Whether the benchmark still measures what it says, not how much: it refuses launches that were
# held or not scheduled.
if(TARGET urgengo_call_bench AND NOT URGENGO_SANITIZE)
  add_test(NAME "urgengo bench calls times scheduled launches that wait for no task"
    COMMAND "${_prints}" "scheduled/by_name/cuLaunchKernelEx +3 chains +[0-9].* 10 chains, NVTX tool +[0-9]"
            $<TARGET_FILE:urgengo> bench calls --rounds 1 --min-seconds 0.001 --chains 1,3)
  set_tests_properties("urgengo bench calls times scheduled launches that wait for no task"
    PROPERTIES LABELS interposer TIMEOUT 120)
endif()

# The same for the other one; on the simulated GPU, so without its numbers.
if(TARGET urgengo_launch_bench AND NOT URGENGO_SANITIZE)
  add_test(NAME "urgengo bench launches runs every condition as it says"
    COMMAND "${_prints}" "200 +scheduled +[0-9]"
            $<TARGET_FILE:urgengo> bench launches --iterations 1 --rounds 1 --seconds 0.05 --frame-launches 200)
  set_tests_properties("urgengo bench launches runs every condition as it says"
    PROPERTIES LABELS interposer TIMEOUT 120
               ENVIRONMENT "LD_LIBRARY_PATH=$<TARGET_FILE_DIR:urgengo_simgpu>")
  add_test(NAME "urgengo bench tracking runs every row as it says"
    COMMAND "${_prints}" "overlapped +30 +beside +[-0-9]"
            $<TARGET_FILE:urgengo> bench tracking --kernel-us 30 --iterations 1 --rounds 1 --seconds 0.02)
  set_tests_properties("urgengo bench tracking runs every row as it says"
    PROPERTIES LABELS interposer TIMEOUT 240
               ENVIRONMENT "LD_LIBRARY_PATH=$<TARGET_FILE_DIR:urgengo_simgpu>")
endif()

# And that of copies: refuses rows in which UrgenGo was not what they say.
if(TARGET urgengo_copy_bench AND NOT URGENGO_SANITIZE)
  add_test(NAME "urgengo_copy_bench runs every row as it says"
    COMMAND "${_prints}" "held, cut at 1 MiB +[0-9]"
            $<TARGET_FILE:urgengo_copy_bench> --interposer $<TARGET_FILE:urgengo_interposer>
            --rounds 1 --seconds 0.1 --large-mib 16 --slice-mib 1)
  set_tests_properties("urgengo_copy_bench runs every row as it says"
    PROPERTIES LABELS interposer TIMEOUT 120
               ENVIRONMENT "LD_LIBRARY_PATH=$<TARGET_FILE_DIR:urgengo_simgpu>")
endif()

# A test of a script's parts that need no program: tests/unit/<script>.
function(urgengo_add_python_test _name _script)
  add_test(NAME "${_name}"
    COMMAND Python3::Interpreter "${CMAKE_SOURCE_DIR}/tests/unit/${_script}")
  set_tests_properties("${_name}"
    PROPERTIES LABELS unit TIMEOUT 60 ENVIRONMENT "PYTHONDONTWRITEBYTECODE=1")
endfunction()

find_package(Python3 COMPONENTS Interpreter)
if(Python3_FOUND)
  urgengo_add_python_test("accuracy_analysis.py tells errors of positions from what is none" test_accuracy_analysis.py)
  urgengo_add_python_test("busy_loops.py computes half of the time, and ends" test_busy_loops.py)
  urgengo_add_python_test("summary.py tells what repeated cells of bench smoke say" test_bench_summary.py)
  urgengo_add_python_test("network_mixes.py draws the same mixes and arrivals, and counts what is skipped" test_network_mixes.py)
  urgengo_add_python_test("modes_in_turns.py compares modes within a cycle" test_modes_in_turns.py)
  urgengo_add_python_test("profile_accuracy.py tells a profile's error from the truth" test_profile_accuracy.py)
  urgengo_add_python_test("sweep.py draws the same workloads and counts who is worse each time" test_sweep.py)
  urgengo_add_python_test("stalls.py stops a program now and then, and changes nothing else" test_stalls.py)
  urgengo_add_python_test("watching_cost.py tells what is more from noise" test_watching_cost.py)
  urgengo_add_python_test("causes_analysis.py finds each cause by kernels alone, and those wrongly named" test_causes_analysis.py)
  urgengo_add_python_test("soak.py tells what hung, was late and was missed" test_soak.py)

  # Whether they still run every row as they say, on the simulated GPU: so without their numbers.
  if(TARGET urgengo_thread_mix AND NOT URGENGO_SANITIZE)
    add_test(NAME "sweep.py runs a workload in every row"
      COMMAND "${_prints}" "\"workloads\": 1, .*\"none\".*\"failed\": \\[\\]"
            "${Python3_EXECUTABLE}" "${CMAKE_SOURCE_DIR}/tools/bench/sweep.py" --build "${CMAKE_BINARY_DIR}"
              --first 5 --count 1 --seconds 0.3 --profile-seconds 1 --no-goals)
    set_tests_properties("sweep.py runs a workload in every row"
      PROPERTIES LABELS interposer TIMEOUT 120 ENVIRONMENT "PYTHONDONTWRITEBYTECODE=1")
    # Real time: alone on the machine, or what else runs would be counted as misses. Worse is what is
    # so each of six times, or four: a machine's noise is not.
    add_test(NAME "sweep.py finds no chain of ten workloads worse than bare"
      COMMAND Python3::Interpreter "${CMAKE_SOURCE_DIR}/tools/bench/sweep.py"
              --build "${CMAKE_BINARY_DIR}" --count 10 --seconds 2 --side-by-side 3 --again 5 --goal 0.6)
    set_tests_properties("sweep.py finds no chain of ten workloads worse than bare"
      PROPERTIES LABELS interposer TIMEOUT 400 RUN_SERIAL ON ENVIRONMENT "PYTHONDONTWRITEBYTECODE=1")
    add_test(NAME "sweep.py finds no chain of the known workloads worse than bare"
      COMMAND Python3::Interpreter "${CMAKE_SOURCE_DIR}/tools/bench/sweep.py"
              --build "${CMAKE_BINARY_DIR}" --specs "${CMAKE_SOURCE_DIR}/tools/bench/known_workloads.json"
              --seconds 2 --side-by-side 4 --again 3 --more-pct 1 --goal 2)
    set_tests_properties("sweep.py finds no chain of the known workloads worse than bare"
      PROPERTIES LABELS interposer TIMEOUT 300 RUN_SERIAL ON ENVIRONMENT "PYTHONDONTWRITEBYTECODE=1")
    add_test(NAME "soak.py runs the chains beside calls before which gates open"
      COMMAND "${_prints}" "disturbed .*cuCtxSynchronize .*\"gates\": [1-9][0-9]*, \"parks\": [1-9]"
            "${Python3_EXECUTABLE}" "${CMAKE_SOURCE_DIR}/tools/bench/soak.py" --build "${CMAKE_BINARY_DIR}"
              --simulated --parts 2 --part-seconds 3 --no-goals --gpu-scale 0.5 --cpu sleep)
    set_tests_properties("soak.py runs the chains beside calls before which gates open"
      PROPERTIES LABELS interposer TIMEOUT 240 ENVIRONMENT "PYTHONDONTWRITEBYTECODE=1"
                 FAIL_REGULAR_EXPRESSION "FAILURE")
    set(_simulated "LD_LIBRARY_PATH=$<TARGET_FILE_DIR:urgengo_simgpu>"
                   "URGENGO_REAL_LIBCUDA=$<TARGET_FILE:urgengo_simgpu>" "PYTHONDONTWRITEBYTECODE=1")
    add_test(NAME "network_mixes.py runs every row as it says"
      COMMAND "${_prints}" "beside a bystander.*bare .*priorities .*urgengo .*paam .*random_2 .*alone .*urgengo/priorities"
            "${Python3_EXECUTABLE}" "${CMAKE_SOURCE_DIR}/tools/bench/network_mixes.py"
              --build "${CMAKE_BINARY_DIR}" --folder "${CMAKE_CURRENT_BINARY_DIR}/network_mixes" --fresh
              --simulated --mixes 3:traced:5 --loads 0.9 --seeds 1 --bystander yes --seconds 0.3
              --warmup 0.1 --profile-seconds 1 --rows bare,priorities,urgengo,paam,random_2,alone)
    set_tests_properties("network_mixes.py runs every row as it says"
      PROPERTIES LABELS interposer TIMEOUT 120 ENVIRONMENT "${_simulated}"
                 FAIL_REGULAR_EXPRESSION "runs failed")
    add_test(NAME "modes_in_turns.py switches a program's modes as it says"
      COMMAND "${_prints}" "off .*shadow .*on .* %   [-+]"
            "${Python3_EXECUTABLE}" "${CMAKE_SOURCE_DIR}/tools/bench/modes_in_turns.py"
              --build "${CMAKE_BINARY_DIR}" --folder "${CMAKE_CURRENT_BINARY_DIR}/modes_in_turns"
              --simulated --mix 3:traced:5 --modes off,shadow,on --cycles 1 --seconds 0.3 --warmup 0.1)
    set_tests_properties("modes_in_turns.py switches a program's modes as it says"
      PROPERTIES LABELS interposer TIMEOUT 120 ENVIRONMENT "${_simulated}")
    add_test(NAME "profile_accuracy.py compares a profile as it says"
      COMMAND "${_prints}" "default: [012] of 2 within"
            "${Python3_EXECUTABLE}" "${CMAKE_SOURCE_DIR}/tools/bench/profile_accuracy.py"
              --build "${CMAKE_BINARY_DIR}" --simulated --networks resnet18,mixer --sources default)
    set_tests_properties("profile_accuracy.py compares a profile as it says"
      PROPERTIES LABELS interposer TIMEOUT 120 ENVIRONMENT "${_simulated}" FAIL_REGULAR_EXPRESSION "not learned")
  endif()
endif()
