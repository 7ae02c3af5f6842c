//! What every operation of the description has in common.

use utoipa::openapi::{
    Content, Object, ObjectBuilder, OpenApi, Ref, RefOr, ResponseBuilder, Schema,
    path::Operation,
    schema::{AdditionalProperties, ArrayItems, KnownFormat, SchemaFormat, SchemaType, Type},
    security::{HttpAuthScheme, HttpBuilder, SecurityScheme},
};
use volery_api::PROBLEM_JSON;

/// Tokens, problems, and bytes that are no lists of numbers.
pub(crate) fn complete(mut openapi: OpenApi) -> OpenApi {
    let scheme = HttpBuilder::new()
        .scheme(HttpAuthScheme::Bearer)
        .description(Some("A token from `POST /v1/tokens`"))
        .build();
    if let Some(components) = &mut openapi.components {
        components.add_security_scheme("bearer", SecurityScheme::Http(scheme));
    }
    let problem = ResponseBuilder::new()
        .description("The request was not done")
        .content(PROBLEM_JSON, Content::new(Some(RefOr::Ref(Ref::from_schema_name("Problem")))))
        .build();
    for item in openapi.paths.paths.values_mut() {
        let operations: [&mut Option<Operation>; 5] =
            [&mut item.get, &mut item.post, &mut item.put, &mut item.patch, &mut item.delete];
        for operation in operations.into_iter().flatten() {
            describe_bytes(operation);
            let responses = &mut operation.responses.responses;
            responses.insert("default".to_owned(), RefOr::T(problem.clone()));
        }
    }
    openapi
}

fn describe_bytes(operation: &mut Operation) {
    for answer in operation.responses.responses.values_mut() {
        if let RefOr::T(answer) = answer {
            answer.content.iter_mut().for_each(|(media, content)| describe_body(media, content));
        }
    }
    if let Some(RefOr::T(body)) = &mut operation.request_body {
        body.content.iter_mut().for_each(|(media, content)| describe_body(media, content));
    }
}

/// `Vec<u8>` is derived as a list of numbers; it is the body itself, or the parts of a form.
fn describe_body(media: &str, content: &mut RefOr<Content>) {
    let RefOr::T(content) = content else { return };
    if matches!(&content.schema, Some(RefOr::T(Schema::Array(array))) if is_byte(&array.items)) {
        let schema = if media == "multipart/form-data" { form() } else { bytes() };
        content.schema = Some(RefOr::T(Schema::Object(schema)));
    }
}

fn is_byte(items: &ArrayItems) -> bool {
    let ArrayItems::RefOrSchema(item) = items else { return false };
    let integer = SchemaType::from(Type::Integer);
    matches!(item.as_ref(), RefOr::T(Schema::Object(object)) if object.schema_type == integer)
}

fn bytes() -> Object {
    let format = SchemaFormat::KnownFormat(KnownFormat::Binary);
    ObjectBuilder::new().schema_type(Type::String).format(Some(format)).build()
}

fn form() -> Object {
    let part = AdditionalProperties::RefOr(RefOr::T(Schema::Object(bytes())));
    ObjectBuilder::new().schema_type(Type::Object).additional_properties(Some(part)).build()
}
