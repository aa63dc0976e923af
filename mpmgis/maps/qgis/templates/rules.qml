<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="AllStyleCategories">
 <renderer-v2 symbollevels="0" enableorderby="0" forceraster="0" type="RuleRenderer">
  <rules key="$key">$rules</rules>
  <symbols>$symbols</symbols>
 </renderer-v2>
 <blendMode>0</blendMode>
</qgis>
