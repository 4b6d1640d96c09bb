use rigbench::gpu::{AdapterKind, Evaluator, Gpu, GpuError, NoGpu, ShaderText, WgslExpression};

use crate::on_gpu;

#[test]
fn an_adapter_describes_itself() {
    on_gpu("an_adapter_describes_itself", |gpu| {
        let adapter = gpu.adapter();
        assert!(!adapter.name.is_empty() && adapter.backend == "vulkan");
        assert_eq!(adapter.software, adapter.device_type == "Cpu");
        assert_eq!(adapter.software, adapter.label().ends_with("(software)"));
        assert!(adapter.limits.max_storage_buffer_binding_size >= 128 << 20);
        assert_eq!(&Gpu::adapters()[0], adapter, "the preferred adapter stands first");
        let refused = if adapter.software { AdapterKind::Hardware } else { AdapterKind::Software };
        if Gpu::adapters().iter().all(|other| other.software == adapter.software) {
            assert!(matches!(Gpu::open(refused), Err(NoGpu::WrongKind { .. })));
        }
    });
}

/// The child of the test below: opens whatever there is and reports it.
#[test]
#[ignore = "run by a_machine_without_a_driver_is_an_error_that_says_what_to_install"]
fn child_opens_a_device() {
    match Gpu::open(AdapterKind::Any) {
        Ok(gpu) => println!("opened {}", gpu.adapter().label()),
        Err(error) => println!("refused: {error}"),
    }
}

#[test]
fn a_machine_without_a_driver_is_an_error_that_says_what_to_install() {
    let child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--ignored", "--exact", "device::child_opens_a_device", "--nocapture"])
        .env("VK_DRIVER_FILES", "/no/such/driver.json")
        .env("VK_ICD_FILENAMES", "/no/such/driver.json")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&child.stdout);
    assert!(child.status.success(), "{said}{}", String::from_utf8_lossy(&child.stderr));
    assert!(said.contains("refused: ") && said.contains("mesa-vulkan-drivers"), "{said}");
}

#[test]
fn a_bad_shader_fails_its_own_work_alone() {
    on_gpu("a_bad_shader_fails_its_own_work_alone", |gpu| {
        for bad in ["fn rig_taps(q: vec3f) { tap(0u, no_such_name); }", "not WGSL", ""] {
            match Evaluator::new(gpu, bad, 3) {
                Err(GpuError::Refused { reason, .. }) => assert!(!reason.is_empty()),
                other => panic!("{bad:?} gave {other:?}"),
            }
        }
        assert!(!gpu.is_lost());
        let works = WgslExpression {
            functions: ShaderText::new().with("fn half(x: f32) -> f32 { return 0.5 * x; }"),
            body: "output(0u, half(input(0u)));",
            inputs: 1,
            outputs: 1,
        };
        let rows: Vec<f32> = (0..1000).map(|i| i as f32).collect();
        let expected: Vec<f32> = rows.iter().map(|x| 0.5 * x).collect();
        assert_eq!(works.run(gpu, &rows).unwrap(), expected);
    });
}

#[test]
fn a_lost_device_is_an_error_of_the_work_that_meets_it() {
    on_gpu("a_lost_device_is_an_error_of_the_work_that_meets_it", |_| {
        // a device of its own: the shared one must live on
        let gpu = Gpu::open(AdapterKind::Any).unwrap();
        let evaluator = Evaluator::new(&gpu, "fn rig_taps(q: vec3f) { tap(0u, 1.0); }", 2).unwrap();
        gpu.close();
        let vectors = rigbench::rig::ShVectors::zeros(2, 1);
        let outcome = evaluator.evaluate(&vectors, &Default::default());
        assert!(matches!(outcome, Err(GpuError::Lost { .. })), "{outcome:?}");
        assert!(gpu.is_lost());
    });
}
